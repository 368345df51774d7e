"""Placements of known truth to train the judge with: of maps that are drawn, and of maps by SLAM, from files."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.plans.bim import Split
from data.scene_graph import SceneGraph
from data.scene_graph.graph import mirrored
from data.synthetic_maps.noise_models import NOISE_MODELS, DrawnGraph, draw
from data.synthetic_maps.wall_noise import USUAL, NoiseLevels
from matching.arrays import Index
from matching.engine.assignment import assign
from matching.engine.hypotheses import Hypotheses
from matching.engine.verdict import Signs
from matching.judge.placements import PLACEMENT, RIVALS, TOKEN, Placements, placements_of
from matching.training.slam_maps import placed_maps, searched
from matching.training.truth import KINDS, ROOMS, generated, right_of, seeds_of, surfaces_of, thinned

REGIMES = {"whole": 0.6, "thinned": 0.15, "foreign": 0.2, "mirrored": 0.05}  # shares of plans
OF_OTHERS = ("foreign", "mirrored")  # the map is not in these plans
USUAL_SHARE = 0.3  # of maps with the noise models' own levels
CHANGED, CHANGED_SHARE = ("thinned", "extended"), 0.3  # of maps by SLAM that count in such plans, too
LEVELS = NoiseLevels(2.0, 0.35, 0.4, 0.5, 0.6, 0.3, 0.3)  # the highest; a sigma is at least the inverse


@dataclass(frozen=True)
class Example:
    """Placements, which of them are right (K,), whether it is in another plan or a mirrored one, and of what."""

    placements: Placements
    right: NDArray[np.bool_]
    foreign: bool
    about: str = ""


def drawn_levels(rng: np.random.Generator) -> NoiseLevels:
    """Levels of noise, drawn anew for each map."""
    if rng.random() < USUAL_SHARE:
        return USUAL
    most = asdict(LEVELS)
    sigma = most.pop("sigma") ** rng.uniform(-1, 1)
    return NoiseLevels(float(sigma), **{name: float(rng.uniform(0, high)) for name, high in most.items()})


def drawn_examples(split: Split, seed: int, number: int, count: int) -> list[Example]:
    """The part `number` of the examples of a split: those of `count` maps; always the same."""
    rng, seeds = np.random.default_rng([seed, number, len(split)]), seeds_of(split)
    found: list[Example] = []
    while len(found) < count:
        kind, regime = str(rng.choice(KINDS)), str(rng.choice([*REGIMES], p=[*REGIMES.values()]))
        plan, other = (generated(kind, int(rng.choice(seeds[kind]))).graph for _ in range(2))
        rooms, noise = ROOMS[int(rng.integers(len(ROOMS)))], str(rng.choice(NOISE_MODELS[1:]))
        drawn = draw(other if regime == "foreign" else plan, noise, rng, rooms, levels=drawn_levels(rng))
        plan = mirrored(plan) if regime == "mirrored" else thinned(plan, rng) if regime == "thinned" else plan
        if other is not plan and (made := example(drawn, plan, regime, f"{kind} {noise} {rooms}")) is not None:
            found.append(made)
    return found


def example(drawn: DrawnGraph, plan: SceneGraph, regime: str, about: str) -> Example | None:
    """The example of a drawn map in a plan; None if nothing is found, or the right place is not among the rivals."""
    found = searched(drawn.s_graph, plan)
    if found is None:
        return None
    if regime in OF_OTHERS:
        return _example(*found, (False,) * len(found[0]), True, f"{regime} {about}")
    surfaces = [surfaces_of(found[0], k, assign(found[0], k), drawn) for k in range(min(len(found[0]), 5 * RIVALS))]
    right = right_of(found[0][np.arange(len(surfaces))], drawn, surfaces)
    return _example(*found, right, False, f"{regime} {about}")


def examples_of_maps(folder: Path, rng: np.random.Generator) -> Iterator[tuple[str, Example]]:
    """The examples of the maps of a folder, with their buildings. Raises UserError as `placed_maps` does."""
    for m, regime, found, signs in placed_maps(folder, rng):
        if regime in CHANGED and rng.random() > CHANGED_SHARE:
            continue
        made = _example(found, signs, m.right(found, regime), regime == "foreign", f"{regime} {m.building} slam")
        if made is not None:
            yield m.building, made


def _example(found: Hypotheses, signs: Signs, right: Sequence[bool], foreign: bool, about: str) -> Example | None:
    if any(right) and not any(right[:RIVALS]):
        return None
    placements = placements_of(found, signs)
    return Example(placements, np.array(right[: len(placements)], dtype=bool), foreign, about)


@dataclass(frozen=True)
class Examples:
    """M examples as flat arrays: maps hold stretches of placements (P), and those of tokens (T)."""

    tokens: NDArray[np.float16]  # (T, len(TOKEN))
    features: NDArray[np.float32]  # (P, len(PLACEMENT))
    right: NDArray[np.bool_]  # (P,)
    sizes: Index  # (P,) tokens of each placement
    rivals: Index  # (M,) placements of each map
    foreign: NDArray[np.bool_]  # (M,)
    about: NDArray[np.str_]  # (M,)

    def __len__(self) -> int:
        return len(self.rivals)

    @staticmethod
    def of(examples: Sequence[Example]) -> "Examples":
        """Joins examples; there may be none."""
        each = [e.placements for e in examples]
        order = [np.argsort(p.of, kind="stable") for p in each]
        return Examples(
            np.concatenate(
                [np.zeros((0, len(TOKEN))), *(p.tokens[o] for p, o in zip(each, order, strict=True))]
            ).astype(np.float16),
            np.concatenate([np.zeros((0, len(PLACEMENT)), np.float32), *(p.features for p in each)]),
            np.concatenate([np.zeros(0, bool), *(e.right for e in examples)]),
            np.concatenate([np.zeros(0, int), *(np.bincount(p.of, minlength=len(p)) for p in each)]),
            np.array([len(p) for p in each], dtype=np.int64),
            np.array([e.foreign for e in examples], dtype=bool),
            np.array([e.about for e in examples], dtype=np.str_),
        )

    @staticmethod
    def joined(parts: Sequence["Examples"]) -> "Examples":
        """All of several."""
        return Examples(*(np.concatenate([getattr(p, name) for p in parts]) for name in Examples.__annotations__))

    def __getitem__(self, chosen: Index) -> "Examples":
        """Some of the maps, each as often as it is chosen."""
        of_map = np.concatenate(([0], np.cumsum(self.rivals)))
        placements = _stretches(of_map[chosen], self.rivals[chosen])
        of_placement = np.concatenate(([0], np.cumsum(self.sizes)))
        tokens = _stretches(of_placement[placements], self.sizes[placements])
        of = self.features[placements], self.right[placements], self.sizes[placements], self.rivals[chosen]
        return Examples(self.tokens[tokens], *of, self.foreign[chosen], self.about[chosen])

    def save(self, path: Path) -> None:
        """Writes the arrays as .npz, at once: an interrupted file is not left behind."""
        from data.common.files import atomic_file

        with atomic_file(path) as file:
            np.savez(file, **vars(self))

    @staticmethod
    def load(path: Path) -> "Examples":
        """Reads what `save` wrote."""
        with np.load(path) as stored:
            return Examples(**{name: stored[name] for name in Examples.__annotations__})


def _stretches(first: Index, size: Index) -> Index:
    """The indices of stretches, one after the other."""
    return np.asarray(np.repeat(first - np.cumsum(size) + size, size) + np.arange(size.sum()))
