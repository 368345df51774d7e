"""The pairs of the matching benchmark: plans and S-graphs drawn from them, independent of the plans' order."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path
from typing import Protocol

import numpy as np

from data import SceneGraph
from data.common.errors import UserError
from data.plans import read_plans
from data.plans.sources import Plan
from data.synthetic_maps.noise_models import NOISE_MODELS, DrawnGraph, draw
from evaluation.drives.slam_graph_files import read_drives
from evaluation.matching_benchmark.rows import written_as
from evaluation.metrics.true_matches import TrueMatches
from matching.ambiguity.symmetries import symmetries

NEGATIVE, SGSLAM = "negative", "sgslam"
DRAWN = (*NOISE_MODELS, NEGATIVE)
COLUMNS = (1, 2, 3, 4, 6, 9, 14)  # rooms seen; the last column is "all"
FIRST_SEED = 900_000  # of generated plans; beyond the seeds of the training data


@dataclass(frozen=True)
class Candidate:
    """A plan and the name of its set; plan names are unique within a set."""

    plans: str
    plan: Plan

    @property
    def size(self) -> int:
        """The number of rooms of the whole plan, all of which are searched."""
        return len(self.plan.graph.rooms)


@dataclass(frozen=True)
class Prepared:
    """A drawn S-graph, the plan to search, and their true matches.

    `twin`: whether an alternative placement explains the S-graph as well as the true one; None without a true one.
    `rival`: the expected evidence (nats) for the truth over the nearest alternative placement; None without one.
    """

    drawn: DrawnGraph
    a_graph: SceneGraph
    truth: TrueMatches
    twin: bool | None
    rival: float | None

    @staticmethod
    def of(drawn: DrawnGraph, a_graph: SceneGraph) -> "Prepared":
        """A pair whose S-graph was drawn from this A-graph."""
        nats = [twin.nats for twin in symmetries(drawn, a_graph)]
        return Prepared(drawn, a_graph, truth_of(drawn), bool(nats), min(nats, default=None))

    @staticmethod
    def negative(drawn: DrawnGraph, a_graph: SceneGraph) -> "Prepared":
        """A pair whose S-graph is of another building."""
        return Prepared(drawn, a_graph, TrueMatches({}, {}, drawn.T_a_s, None, (0.0, 0.0)), None, None)


def truth_of(drawn: DrawnGraph) -> TrueMatches:
    """The true matches of a drawn S-graph in its A-graph."""
    x, y = drawn.s_graph.centroid().tolist()
    return TrueMatches(drawn.rooms, drawn.wall_surfaces, drawn.T_a_s, drawn.floor, (x, y))


class Pair(Protocol):
    """An S-graph and a plan, identified by names until they are drawn. `rooms` is the table's column; None: all."""

    @property
    def regime(self) -> str:
        """The regime that the S-graph is drawn by."""

    @property
    def target(self) -> Candidate:
        """The plan that is searched."""

    @property
    def source_name(self) -> str:
        """The name of the plan that the S-graph is drawn from."""

    @property
    def rooms(self) -> int | None:
        """The number of rooms seen."""

    @property
    def index(self) -> int:
        """The index among otherwise identical pairs."""

    @property
    def seed(self) -> int:
        """The seed of the random numbers."""

    def prepare(self) -> Prepared:
        """Draws or reads the S-graph."""


@dataclass(frozen=True)
class DrawnPair:
    """A pair of an S-graph of `rooms` neighbouring rooms (None: a whole floor) of `source`, and the plan `target`."""

    target: Candidate
    source: Candidate
    regime: str
    rooms: int | None
    index: int
    seed: int

    @property
    def source_name(self) -> str:
        """The set and the name of the plan that the S-graph is drawn from."""
        return f"{self.source.plans}/{self.source.plan.name}"

    def prepare(self) -> Prepared:
        """Draws the S-graph; it depends only on seed, plan, regime, rooms and index."""
        plan = self.source.plan
        name = written_as(self.regime)
        rng = np.random.default_rng(_hash(self.seed, plan.building, plan.name, name, self.rooms, self.index))
        floors = floors_of(plan.graph, self.rooms)
        floor = floors[int(rng.integers(len(floors)))]
        if self.regime == NEGATIVE:
            return Prepared.negative(draw(plan.graph, "real", rng, self.rooms, floor), self.target.plan.graph)
        return Prepared.of(draw(plan.graph, self.regime, rng, self.rooms, floor), plan.graph)


@dataclass(frozen=True)
class SlamPair:
    """A pair of an S-graph that the SLAM system built on a simulated drive, and the building's plan."""

    target: Candidate
    drawn: DrawnGraph
    rooms: int | None
    index: int
    seed: int

    @property
    def regime(self) -> str:
        """`sgslam`."""
        return SGSLAM

    @property
    def source_name(self) -> str:
        """The name of the plan."""
        return f"{self.target.plans}/{self.target.plan.name}"

    def prepare(self) -> Prepared:
        """The recorded S-graph with its truth."""
        return Prepared.of(self.drawn, self.target.plan.graph)


def read_candidates(paths: Sequence[Path], generated: Sequence[str]) -> list[Candidate]:
    """The plans of files and folders, and generated ones: KIND:COUNT, or KIND:COUNT:SKIPPED for the COUNT plans after
    the first SKIPPED. Plans without rooms are left out.

    Raises UserError for an unknown kind, for two sets or two plans of one name, and if there is no plan.
    """
    sets: dict[str, Iterator[Plan]] = {}
    for path in paths:
        name = path.resolve().name
        _add(sets, name.split(".")[0] or name, read_plans(path))
    for text in generated:
        _add(sets, text.partition(":")[0], _generated(text))
    found = [Candidate(name, plan) for name, plans in sets.items() for plan in plans if plan.graph.rooms]
    names = [(c.plans, c.plan.name) for c in found]
    if len(set(names)) < len(names):
        twice = next(n for n in names if names.count(n) > 1)
        raise UserError(f"{twice[0]}: two plans are named '{twice[1]}'; rename one")
    if not found:
        raise UserError("no plan: give --plans PATH or --generated KIND:COUNT")
    return found


def _generated(text: str) -> Iterator[Plan]:
    from data.generation.buildings import KINDS, generate_plan

    kind, *numbers = text.split(":")
    if kind not in KINDS or len(numbers) not in (1, 2) or not all(map(str.isdecimal, numbers)) or int(numbers[0]) == 0:
        raise UserError(f"--generated {text}: write KIND:COUNT or KIND:COUNT:SKIPPED; kinds are {', '.join(KINDS)}")
    count, skipped = [*map(int, numbers), 0][:2]
    return (generate_plan(kind, FIRST_SEED + skipped + n) for n in range(count))


def _add(sets: dict[str, Iterator[Plan]], name: str, plans: Iterator[Plan]) -> None:
    if name in sets:
        raise UserError(f"two sets of plans are named '{name}'; rename one")
    sets[name] = plans


def pairs_of_cell(
    candidates: Sequence[Candidate], regime: str, rooms: int | None, count: int, seed: int
) -> list[DrawnPair]:
    """`count` pairs, distributed evenly over the plans with a floor of at least `rooms` rooms; none if no plan has one.

    Hashes of the names decide which plans get one pair more and which building an `negative` map is of, so that
    neither depends on the order of the plans.
    """
    fit = [c for c in candidates if floors_of(c.plan.graph, rooms)]
    targets = candidates if regime == NEGATIVE else fit
    order = sorted(targets, key=lambda c: _hash(seed, written_as(regime), rooms, c.plan.building, c.plan.name))
    found = []
    for n in range(count if order else 0):
        target, index = order[n % len(order)], n // len(order)
        source = _another(fit, target, rooms, index, seed) if regime == NEGATIVE else target
        if source is not None:
            found.append(DrawnPair(target, source, regime, rooms, index, seed))
    return found


def slam_pairs(folder: Path) -> list[SlamPair]:
    """The S-graphs that `evaluation.drives.slam_graphs` wrote to a folder. Their column is the largest one that they
    fill; the last graph of a drive is in the column "all"."""
    found = []
    buildings: dict[int, str] = {}  # drives through one building share its A-graph
    for drive in read_drives(folder):
        building = buildings.setdefault(id(drive.a_graph), drive.sequence)
        target = Candidate(folder.resolve().name, Plan(drive.sequence, building, drive.a_graph))
        for index, graph in enumerate(drive.graphs):
            rooms = None if graph.whole else max(n for n in COLUMNS if n <= max(1, len(graph.drawn.s_graph.rooms)))
            found.append(SlamPair(target, graph.drawn, rooms, index, drive.seed))
    return found


def floors_of(graph: SceneGraph, rooms: int | None) -> list[str | None]:
    """The floors with at least `rooms` rooms that have walls (None: at least one), in the graph's order."""
    count: dict[str | None, int] = {}
    for room in graph.rooms:
        if graph.surfaces_of_room[room.id]:
            count[room.floor] = count.get(room.floor, 0) + 1
    return [floor for floor, n in count.items() if n >= (rooms or 1)]


def _another(
    sources: Sequence[Candidate], target: Candidate, rooms: int | None, index: int, seed: int
) -> Candidate | None:
    """The plan of another building with the highest hash, which does not depend on the other plans."""
    others = [c for c in sources if (c.plans, c.plan.building) != (target.plans, target.plan.building)]
    names = (target.plan.building, target.plan.name)
    return max(others, key=lambda c: _hash(seed, rooms, index, *names, c.plan.building, c.plan.name), default=None)


def _hash(*key: object) -> int:
    return int.from_bytes(blake2b(repr(key).encode(), digest_size=16).digest())
