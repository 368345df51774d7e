"""The pairs of the matching benchmark: plans and S-graphs drawn from them, independent of the plans' order."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from hashlib import blake2b
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from pydantic import BaseModel, ConfigDict

from data import SceneGraph
from data.generation.buildings import KINDS
from data.plans import Plan
from data.synthetic_maps.noise_models import DrawnGraph, draw
from evaluation.drives.slam_graph_files import SlamDrive, read_drives
from evaluation.matching_benchmark.plan_sets import Candidate, load_plan
from evaluation.metrics.true_matches import TrueMatches
from matching.ambiguity.symmetries import symmetries

Regime = Literal["paper", "real", "drift", "mis_segmented", "heavy_drift", "negative"]
REGIMES: tuple[Regime, ...] = get_args(Regime)
NEGATIVE: Literal["negative"] = "negative"
SGSLAM: Literal["sgslam"] = "sgslam"
# Draws are seeded by the names that three noise models had at first.
WRITTEN_AS = {"mis_segmented": "messy", "heavy_drift": "warped", "negative": "elsewhere"}
COLUMNS = (1, 2, 3, 4, 6, 9, 14)  # rooms seen; the last column is "all"


@dataclass(frozen=True)
class Prepared:
    """A drawn S-graph, the plan to search, and their true matches.

    `twin`: whether an alternative placement explains the S-graph as well as the true one; None without a true one.
    `rival`: the expected evidence (nats) for the truth over the nearest alternative placement; None without one.
    """

    drawn: DrawnGraph
    plan: Plan
    truth: TrueMatches
    twin: bool | None
    rival: float | None

    @staticmethod
    def of(drawn: DrawnGraph, plan: Plan) -> "Prepared":
        """A pair whose S-graph was drawn from this plan."""
        nats = [twin.nats for twin in symmetries(drawn, plan.graph)]
        return Prepared(drawn, plan, truth_of(drawn), bool(nats), min(nats, default=None))


class Pair(BaseModel, ABC):
    """An S-graph and a plan, by names: `plan` is the plan's name in its set `plans` (see `Candidate`).

    `rooms` is the number of rooms seen (None: all), `index` that among otherwise identical pairs, `seed` the seed of
    the random numbers. The S-graph is of another building if there is a `source`: that plan's set and name.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    plans: str
    plan: str
    regime: str
    rooms: int | None
    index: int
    seed: int
    source: tuple[str, str] | None = None

    @abstractmethod
    def prepare(self) -> Prepared:
        """Draws or reads the S-graph."""

    def files(self) -> set[str]:
        """The paths of the files that it reads."""
        return {self.plans, *(self.source or ())[:1]} - set(KINDS)


class DrawnPair(Pair):
    """An S-graph of `rooms` neighbouring rooms (None: a whole floor), drawn from a plan."""

    regime: Regime

    def prepare(self) -> Prepared:
        """Draws the S-graph; it depends only on seed, plan, regime, rooms and index."""
        target = load_plan(self.plans, self.plan)
        if self.source is None:
            return Prepared.of(self.drawn_from(target), target)
        drawn = self.drawn_from(load_plan(*self.source))
        return Prepared(drawn, target, TrueMatches({}, {}, drawn.T_a_s, None, (0.0, 0.0)), None, None)

    def drawn_from(self, plan: Plan) -> DrawnGraph:
        """An S-graph of a plan, for this pair."""
        name = WRITTEN_AS.get(self.regime, self.regime)
        rng = np.random.default_rng(number_of(self.seed, plan.building, plan.name, name, self.rooms, self.index))
        floors = floors_of(plan.graph, self.rooms)
        floor = floors[int(rng.integers(len(floors)))]
        return draw(plan.graph, "real" if self.regime == NEGATIVE else self.regime, rng, self.rooms, floor)


class SlamPair(Pair):
    """An S-graph that the SLAM system built on a simulated drive, and the building's plan: the graph number `index` of
    the drive `plan` with this seed in the folder `plans`."""

    regime: Literal["sgslam"] = SGSLAM

    def prepare(self) -> Prepared:
        """The recorded S-graph with its truth."""
        drive, building = _drives(self.plans)[self.plan, self.seed]
        return Prepared.of(drive.graphs[self.index].drawn, Plan(drive.sequence, building, drive.a_graph))


@lru_cache(maxsize=4)
def prepared(pair: Pair) -> Prepared:
    """The pair's graphs; the last few are kept, since several methods are asked."""
    return pair.prepare()


def truth_of(drawn: DrawnGraph) -> TrueMatches:
    """The true matches of a drawn S-graph in its A-graph."""
    x, y = drawn.s_graph.centroid().tolist()
    return TrueMatches(drawn.rooms, drawn.wall_surfaces, drawn.T_a_s, drawn.floor, (x, y))


@lru_cache(maxsize=1)
def _drives(folder: str) -> dict[tuple[str, int], tuple[SlamDrive, str]]:
    """The drives of a folder by name and seed, with their building: drives through one building share its A-graph."""
    found = {}
    buildings: dict[int, str] = {}
    for drive in read_drives(Path(folder)):
        building = buildings.setdefault(id(drive.a_graph), drive.sequence)
        found[drive.sequence, drive.seed] = drive, building
    return found


def pairs_of_cell(
    candidates: Sequence[Candidate], regime: Regime, rooms: int | None, count: int, seed: int
) -> list[DrawnPair]:
    """`count` pairs, distributed evenly over the plans with a floor of at least `rooms` rooms; none if no plan has one.

    Hashes of the names decide which plans get one pair more and which building an `negative` map is of, so that
    neither depends on the order of the plans.
    """
    fit = [c for c in candidates if floors_of(c.plan.graph, rooms)]
    targets, name = candidates if regime == NEGATIVE else fit, WRITTEN_AS.get(regime, regime)
    order = sorted(targets, key=lambda c: number_of(seed, name, rooms, c.plan.building, c.plan.name))
    found = []
    for n in range(count if order else 0):
        target, index = order[n % len(order)], n // len(order)
        names: dict[str, Any] = {"plans": target.plans, "plan": target.plan.name}
        if regime == NEGATIVE:
            other = _another(fit, target, rooms, index, seed)
            if other is None:
                continue
            names["source"] = other.plans, other.plan.name
        found.append(DrawnPair(**names, regime=regime, rooms=rooms, index=index, seed=seed))
    return found


def slam_pairs(folder: Path) -> list[SlamPair]:
    """The S-graphs that `evaluation.drives.slam_graphs` wrote to a folder. Their column is the largest one that they
    fill; the last graph of a drive is in the column "all". Where the folder is missing, a single pair, which the
    harness skips. Raises UserError for a folder without any."""
    if not folder.exists():
        return [SlamPair(plans=str(folder), plan="", rooms=None, index=0, seed=0)]
    found = []
    for (sequence, seed), (drive, _) in _drives(str(folder)).items():
        for index, graph in enumerate(drive.graphs):
            rooms = None if graph.whole else max(n for n in COLUMNS if n <= max(1, len(graph.drawn.s_graph.rooms)))
            found.append(SlamPair(plans=str(folder), plan=sequence, rooms=rooms, index=index, seed=seed))
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
    return max(others, key=lambda c: number_of(seed, rooms, index, *names, c.plan.building, c.plan.name), default=None)


def number_of(*key: object) -> int:
    """A number that depends on these values alone: a hash."""
    return int.from_bytes(blake2b(repr(key).encode(), digest_size=16).digest())
