"""The pairs of the published tables: the published perturbation, with the start moved, and maps built by SLAM."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from hashlib import blake2b
from pathlib import Path

import numpy as np

from data.geometry import se2
from data.plans import read_plans
from data.plans.sources import Plan
from data.scene_graph import SceneGraph
from data.scene_graph.motion import moved
from data.synthetic_maps.noise_models import DrawnGraph
from evaluation.matching_benchmark.pairs import Candidate, DrawnPair, Pair, Prepared, pairs_of_cell, read_candidates
from evaluation.metrics.surface_overlap import best_rigid_fit
from evaluation.published.se2_subsets import Known, parts

SE2, SE2_ANYWHERE = "se2", "se2-anywhere"
STARTS = (1.0, 5.0, 20.0)  # metres
REACH = 20.0  # metres, largest shift of a map along each axis
SITE = 15.0  # metres, largest distance of a published plan's centre from its origin, along each axis


def start_regime(metres: float) -> str:
    """The name of the published perturbation with a start known to within `metres` along each axis."""
    return f"paper+{metres:g}m" if metres else "paper"


@dataclass(frozen=True)
class MovedPair:
    """Another pair with its S-graph moved: shifted by at most `reach` (m) along each axis, and rotated if `turned`."""

    pair: Pair
    regime: str
    reach: float
    turned: bool = False

    @property
    def target(self) -> Candidate:
        """As of the other pair."""
        return self.pair.target

    @property
    def source_name(self) -> str:
        """As of the other pair."""
        return self.pair.source_name

    @property
    def rooms(self) -> int | None:
        """As of the other pair."""
        return self.pair.rooms

    @property
    def index(self) -> int:
        """As of the other pair."""
        return self.pair.index

    @property
    def seed(self) -> int:
        """As of the other pair."""
        return self.pair.seed

    def prepare(self) -> Prepared:
        """Moves the S-graph by a motion that depends only on the pair and the regime."""
        prepared = self.pair.prepare()
        rng = np.random.default_rng(_hash(self.regime, self.source_name, self.rooms, self.index, self.seed))
        yaw = rng.uniform(-np.pi, np.pi) if self.turned else 0.0
        T_new_s = np.array([yaw, *rng.uniform(-self.reach, self.reach, 2)])
        T_s_new = se2.inverse(T_new_s)

        def from_new(T_a_s: tuple[float, float, float]) -> tuple[float, float, float]:
            turn, x, y = se2.compose(np.array(T_a_s), T_s_new).tolist()
            return turn, x, y

        drawn = prepared.drawn
        drawn = replace(
            drawn, s_graph=moved(drawn.s_graph, T_new_s), T_a_s=from_new(drawn.T_a_s),
            T_a_s_by_room={room: from_new(T) for room, T in drawn.T_a_s_by_room.items()},
        )  # fmt: skip
        x, y = drawn.s_graph.centroid().tolist()
        truth = replace(prepared.truth, T_a_s=drawn.T_a_s, s_centroid=(x, y))
        return replace(prepared, drawn=drawn, truth=truth)


@dataclass(frozen=True)
class KnownMapPair:
    """A part of a map with known true matches, in the map's own frame."""

    target: Candidate
    drawn: DrawnGraph
    rooms: int | None
    index: int
    seed: int = 0
    regime: str = SE2

    @property
    def source_name(self) -> str:
        """The name of the plan."""
        return f"{self.target.plans}/{self.target.plan.name}"

    def prepare(self) -> Prepared:
        """The part with its truth."""
        return Prepared.of(self.drawn, self.target.plan.graph)


def known_map_pairs(file: Path) -> list[Pair]:
    """Every part of a known map with at least 2 rooms, in its own frame and moved."""
    known = Known.load(file)
    name = file.stem
    target = Candidate(name, Plan(name, name, known.a_graph))
    found: list[Pair] = []
    for index, part in enumerate(parts(known)):
        rooms = None if len(part.rooms) == len(known.s_graph.rooms) else len(part.rooms)
        pair = KnownMapPair(target, _drawn(known, part), rooms, index)
        found += [pair, MovedPair(pair, SE2_ANYWHERE, REACH, turned=True)]
    return found


def _drawn(known: Known, part: SceneGraph) -> DrawnGraph:
    walls = {w.id: known.wall_surfaces[w.id] for w in part.wall_surfaces if w.id in known.wall_surfaces}
    rooms = {r.id: known.rooms[r.id] for r in part.rooms if r.id in known.rooms}
    yaw, x, y = best_rigid_fit(part, known.a_graph, walls).tolist()
    floor = known.a_graph.room_by_id[next(iter(rooms.values()))].floor if rooms else None
    return DrawnGraph(part, rooms, walls, (yaw, x, y), dict.fromkeys(rooms, (yaw, x, y)), floor, False)


def published_candidates(folder: Path) -> list[Candidate]:
    """The plans of a folder, with every edge of a room as a wall surface as in the published data."""
    plans = (p for p in read_plans(folder, merge_collinear=False) if p.graph.rooms)
    return [Candidate(f"{folder.resolve().name}-edges", p) for p in plans]


def generated_candidates(count: int) -> list[Candidate]:
    """Generated apartments outside the training data, as close to the origin as the published data."""
    return [replace(c, plan=replace(c.plan, graph=_near_origin(c.plan))) for c in _apartments(count)]


def _apartments(count: int) -> Iterator[Candidate]:
    yield from read_candidates([], [f"apartment:{count}"])


def _near_origin(plan: Plan) -> SceneGraph:
    rng = np.random.default_rng(_hash(plan.name))
    return moved(plan.graph, np.array([0.0, *(rng.uniform(-SITE, SITE, 2) - plan.graph.centroid())]))


def with_starts(pairs: Sequence[DrawnPair]) -> list[Pair]:
    """The pairs, and each of them with its start moved by the distances `STARTS`."""
    return [*pairs, *(MovedPair(p, start_regime(m), m) for m in STARTS for p in pairs)]


def real_pairs(folder: Path, rooms: Sequence[int | None], count: int, seed: int) -> list[Pair]:
    """Maps of the regime `real` of the plans of a folder: `count` for each number of rooms."""
    candidates = read_candidates([folder], [])
    return [p for n in rooms for p in pairs_of_cell(candidates, "real", n, count, seed)]


def _hash(*key: object) -> int:
    return int.from_bytes(blake2b(repr(key).encode(), digest_size=16).digest())
