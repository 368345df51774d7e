"""Placements of known truth to train the judge with: of maps that are drawn, and of maps by SLAM, from files."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.common.files import write_json
from data.plans.sources import Split, split_of
from data.scene_graph import SceneGraph
from data.scene_graph.graph import mirrored
from data.synthetic_maps.noise_models import NOISE_MODELS, DrawnGraph, draw
from data.synthetic_maps.wall_noise import USUAL, NoiseLevels
from matching.arrays import Index
from matching.engine.assignment import assign
from matching.engine.hypotheses import Hypotheses, scene_of, search
from matching.engine.plan_walls import PlanWalls
from matching.engine.verdict import Signs
from matching.judge.placements import PLACEMENT, RIVALS, TOKEN, Placements, placements_of
from matching.training.truth import KINDS, ROOMS, generated, is_near, right_of, seeds_of, surfaces_of, thinned

REGIMES = {"whole": 0.6, "thinned": 0.15, "foreign": 0.2, "mirrored": 0.05}  # shares of plans
OF_OTHERS = ("foreign", "mirrored")  # the map is not in these plans
USUAL_SHARE = 0.3  # of maps with the noise models' own levels
LEVELS = NoiseLevels(2.0, 0.35, 0.4, 0.5, 0.6, 0.3, 0.3)  # the highest; a sigma is at least the inverse


@dataclass(frozen=True)
class MapInPlan:
    """A map by SLAM: its S-graph, of the file `plan`; its true place and storey there."""

    building: str
    s_graph: SceneGraph
    plan: str
    T_a_s: tuple[float, float, float]
    floor: str | None

    def save(self, path: Path) -> None:
        """Writes the map as JSON; `plan` is beside it."""
        write_json(path, {**asdict(replace(self, s_graph=None)), "s_graph": self.s_graph.to_dict()})  # type: ignore[arg-type]

    @staticmethod
    def load(path: Path) -> "MapInPlan":
        """Reads a map. Raises UserError."""
        try:
            stored: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
            place = stored["T_a_s"][0], stored["T_a_s"][1], stored["T_a_s"][2]
            graph = SceneGraph.from_dict(stored["s_graph"])
            return MapInPlan(stored["building"], graph, stored["plan"], place, stored["floor"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise UserError(f"{path}: no map of python -m evaluation.maps ({error!r})") from None


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
    found = _searched(drawn.s_graph, plan)
    if found is None:
        return None
    if regime in OF_OTHERS:
        return _example(found, (False,) * len(found), True, f"{regime} {about}")
    surfaces = [surfaces_of(found, k, assign(found, k), drawn) for k in range(min(len(found), 5 * RIVALS))]
    right = right_of(found[np.arange(len(surfaces))], drawn, surfaces)
    return _example(found, right, False, f"{regime} {about}")


def examples_of_maps(folder: Path, rng: np.random.Generator) -> Iterator[tuple[str, list[Example]]]:
    """For each map of a folder, its building and the examples of its own plan, whole and thinned, and of another's.

    Raises UserError as `MapInPlan.load` does, and if there is no map, or maps of one building alone.
    """
    maps = [MapInPlan.load(path) for path in sorted(folder.glob("*.map.json"))]
    plans = {name: SceneGraph.load(folder / name) for name in sorted({m.plan for m in maps})}
    building = {m.plan: m.building for m in maps}
    if len(set(building.values())) < 2:
        raise UserError(f"{folder}: no maps of several buildings; python -m evaluation.maps writes them")
    for m in maps:
        others = [plan for plan, name in building.items() if name != m.building]
        # a plan that training sees must not be met again in validation
        others = [plan for plan in others if split_of(building[plan]) == split_of(m.building)] or others
        made: list[Example | None] = []
        for regime in ("whole", "thinned", "foreign"):
            plan = plans[m.plan if regime != "foreign" else str(rng.choice(others))]
            found = _searched(m.s_graph, thinned(plan, rng) if regime == "thinned" else plan)
            if found is not None:
                foreign = regime == "foreign"
                near = [False] * len(found) if foreign else is_near(found, m.s_graph, np.array(m.T_a_s), m.floor)
                made.append(_example(found, near, foreign, f"{regime} {m.building} slam {len(m.s_graph.rooms)}"))
        yield m.building, [e for e in made if e is not None]


def _searched(s: SceneGraph, plan: SceneGraph) -> Hypotheses | None:
    walls = PlanWalls.of(plan)
    found = None if walls is None or not s.wall_surfaces else search(scene_of(s, walls))
    return found if found is not None and len(found) else None


def _example(found: Hypotheses, right: Sequence[bool], foreign: bool, about: str) -> Example | None:
    if any(right) and not any(right[:RIVALS]):
        return None
    placements = placements_of(found, Signs.of(found))
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
