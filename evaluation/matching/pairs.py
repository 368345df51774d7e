"""Maps with known truth and the plans in which they are to be found, independent of the plans' order."""

import json
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from hashlib import blake2b
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from data import SceneGraph
from data.common.errors import UserError
from data.generation.buildings import KINDS, generate_plan
from data.geometry import se2
from data.plans import Plan, read_plans
from data.plans.bim import split_of
from data.scene_graph.graph import moved
from data.synthetic_maps.noise_models import DrawnGraph, Motion, draw
from evaluation.buildings import GENERATED, building_named
from evaluation.drive import DriveCase
from evaluation.matching.own_maps import own_maps
from evaluation.metrics.surface_overlap import best_rigid_fit
from evaluation.metrics.true_matches import TrueMatches
from evaluation.study import Case, key_of

Regime = Literal[
    "real", "drift", "mis_segmented", "heavy_drift", "paper", "negative", "perturbed", "perturbed and shifted"
]
REGIMES: tuple[Regime, ...] = get_args(Regime)
NEGATIVE, PERTURBED, SHIFTED = REGIMES[-3:]
SHIFT_M = 20.0
SGSLAM, PUBLISHED_MAP = "sgslam", "published map"
PUBLISHED = (PERTURBED, SHIFTED, PUBLISHED_MAP)
WHOLE = ("paper", PERTURBED, SHIFTED)  # these drop rooms by themselves
MADE, PAPERS_SET = "generated", "msd"
# The networks were trained on the first of these sets, and on generated plans below FIRST_SEED; settings were chosen by
# the others, and by generated plans below FIRST_TEST_SEED.
TRAINING = ("resplan",)
DEVELOPMENT = ("swiss_floors", "AC11-Institute-Var-2-IFC", "Office_A_20110811", "demo", "institute", "office")
FIRST_SEED, FIRST_TEST_SEED = 900_000, 902_000


@dataclass(frozen=True)
class KnownMap:
    """A map with its true matches, and the A-graph in which it is to be found."""

    drawn: DrawnGraph
    a_graph: SceneGraph

    @property
    def truth(self) -> TrueMatches:
        """The true matches; none for a map of another building."""
        return truth_of(self.drawn)


def truth_of(drawn: DrawnGraph) -> TrueMatches:
    """The true matches of a drawn S-graph."""
    x, y = drawn.s_graph.centroid().tolist()
    return TrueMatches(drawn.rooms, drawn.wall_surfaces, drawn.T_a_s, drawn.floor, (x, y))


class MatchCase(Case):
    """A map, a plan, and the method that looks for one in the other, by names.

    `plans` is a file or folder of plans, `generated`, or `sgslam`; `plan` a plan's name in it, or a building of
    `evaluation.buildings`, which is driven through for `seconds`. `rooms` is the number of rooms seen (None: all),
    `index` that among otherwise equal pairs. A map is drawn by a noise model, or by one of these regimes: `negative`
    (`real`, of another building: the plan `source`), `perturbed` (`paper`, of a plan in which each edge of a room is a
    wall surface, as in the paper's data), `perturbed and shifted` (its start is anywhere within 20 m along each axis).
    """

    plans: str
    plan: str
    regime: str
    rooms: int | None = None
    index: int = 0
    seed: int = 0
    source: tuple[str, str] | None = None
    seconds: float | None = None
    method: str = ""
    limit_s: float = 60.0

    @property
    def group(self) -> str:
        """The plan: what is read and prepared of it is shared."""
        return key_of(self.model_dump(mode="json", include={"plans", "plan", "seed", "seconds"}))

    @property
    def depends(self) -> tuple[str, ...]:
        """Drawn maps are not made by the system."""
        return super().depends if self.regime == SGSLAM else ("data", "matching")

    @property
    def drive(self) -> DriveCase:
        """The drive on which the system builds the maps."""
        return DriveCase(building=self.plan, seed=self.seed, seconds=self.seconds)

    def files(self) -> set[str]:
        """The paths of the plans."""
        if self.regime == SGSLAM:
            return self.drive.files()
        return {self.plans, *(self.source or ())[:1]} - {MADE}


@lru_cache(maxsize=4)
def known_maps(pair: MatchCase, work: Path) -> tuple[KnownMap, ...]:
    """The maps of a pair: several of a drive, else one. The last pairs are kept, since several methods get them."""
    if pair.regime == SGSLAM:
        drawn, plan = own_maps(pair.drive, work)
        return tuple(KnownMap(one, plan) for one in drawn)
    made = {PERTURBED: _perturbed, SHIFTED: _perturbed, PUBLISHED_MAP: _published_map}.get(pair.regime, _drawn)
    return (made(pair),)


def _drawn(pair: MatchCase) -> KnownMap:
    plan = load_plan(pair.plans, pair.plan)
    seen = plan if pair.source is None else load_plan(*pair.source)
    rng = np.random.default_rng(number_of(pair.seed, seen.building, seen.name, pair.regime, pair.rooms, pair.index))
    floors = floors_of(seen.graph, pair.rooms)
    noise = "real" if pair.regime == NEGATIVE else pair.regime
    drawn = draw(seen.graph, noise, rng, pair.rooms, floors[int(rng.integers(len(floors)))])
    if pair.source is not None:
        drawn = replace(drawn, rooms={}, wall_surfaces={}, T_a_s_by_room={}, floor=None)
    return KnownMap(drawn, plan.graph)


def _perturbed(pair: MatchCase) -> KnownMap:
    graph = _plans(pair.plans, merge_collinear=False)[pair.plan].graph
    rng = np.random.default_rng(number_of(pair.seed, pair.plan, pair.index))
    drawn = draw(graph, "paper", rng)
    T_new_s = np.array([0.0, *rng.uniform(-SHIFT_M, SHIFT_M, 2) * (pair.regime == SHIFTED)])
    s_graph = moved(drawn.s_graph, T_new_s)
    yaw, x, y = se2.compose(np.array(drawn.T_a_s), se2.inverse(T_new_s)).tolist()
    return KnownMap(_rigid(s_graph, drawn.rooms, drawn.wall_surfaces, (yaw, x, y), drawn.floor), graph)


def _published_map(pair: MatchCase) -> KnownMap:
    """A map of a file with `s_graph`, `a_graph` and `matches` ({"rooms", "wall_surfaces"}: [[S id, A id], ...]).

    It lies where its true walls fit best.
    """
    try:
        value = json.loads(Path(pair.plans).read_text())
        s, a = (SceneGraph.from_dict(value[name]) for name in ("s_graph", "a_graph"))
        rooms, walls = (dict(value["matches"][name]) for name in ("rooms", "wall_surfaces"))
        floor = a.room_by_id[next(iter(rooms.values()))].floor
    except (UserError, OSError, ValueError, KeyError, TypeError, StopIteration):
        raise UserError(f"{pair.plans}: needs s_graph, a_graph and matches of rooms and walls, as JSON") from None
    yaw, x, y = best_rigid_fit(s, a, walls).tolist()
    return KnownMap(_rigid(s, rooms, walls, (yaw, x, y), floor), a)


def _rigid(s: SceneGraph, rooms: Any, walls: Any, T_a_s: Motion, floor: str | None) -> DrawnGraph:
    return DrawnGraph(s, rooms, walls, T_a_s, dict.fromkeys(rooms, T_a_s), floor, False)


def described(pair: MatchCase, trained_on: Collection[str] = ()) -> dict[str, str]:
    """The set, the building and its role. A network may be trained on more sets of plans than ours; training leaves
    some buildings of a set aside for tests."""
    name = re.sub(r"\.(ifc|json|tar\.gz)$", "", Path(pair.plans).name)
    kind, _, seed = pair.plan.removeprefix(GENERATED).rpartition("_")
    if kind in KINDS:
        role = "training" if int(seed) < FIRST_SEED else "development" if int(seed) < FIRST_TEST_SEED else "test"
        return {"set": name, "building": f"{GENERATED}{kind}_{seed}", "role": role}
    if pair.regime == SGSLAM:
        return {"set": name, "building": pair.plan, "role": building_named(pair.plan).role}
    if pair.regime == PUBLISHED_MAP:
        return {"set": name, "building": name, "role": "test"}
    own = load_plan(pair.plans, pair.plan).building
    trained = name in (*TRAINING, *trained_on) and split_of(own) != "test"
    role = "training" if trained else "development" if name in DEVELOPMENT else "test"
    return {"set": "IFC" if pair.plans.endswith(".ifc") else name, "building": f"{name}/{own}", "role": role}


@dataclass(frozen=True)
class Candidate:
    """A plan and its set."""

    plans: str
    plan: Plan

    @property
    def pool(self) -> tuple[str, ...]:
        """Role and set: pairs are distributed over the plans of one pool."""
        named = described(MatchCase(plans=self.plans, plan=self.plan.name, regime=REGIMES[0]))
        return named["role"], named["set"]


def load_plan(plans: str, name: str) -> Plan:
    """A plan of a set. Raises UserError as `read_plans` does, and for an unknown name."""
    if plans == MADE:
        return _made(name)
    plan = _plans(plans).get(name)
    if plan is None:
        raise UserError(f"{plans}: no plan '{name}' with rooms")
    return plan


def read_candidates(paths: Sequence[str], generated: Sequence[str]) -> list[Candidate]:
    """The plans with rooms of files and folders, and generated ones: KIND_SEED.

    Raises UserError for an unknown kind, for two plans of one name in a set, and as `read_plans` does.
    """
    found = [Candidate(path, plan) for path in paths for plan in _plans(path).values()]
    return found + [Candidate(MADE, _made(name)) for name in generated]


def pairs_of_cell(
    candidates: Sequence[Candidate], regime: str, rooms: int | None, count: int, seed: int
) -> list[MatchCase]:
    """`count` pairs, distributed evenly over the plans with a floor of at least `rooms` rooms; none if no plan has one.

    Hashes of the names decide which plans get one pair more and which building a map of another one is of, so that
    neither depends on the order of the plans.
    """
    fit = [c for c in candidates if floors_of(c.plan.graph, rooms)]
    fit = [c for c in fit if regime not in PUBLISHED or Path(c.plans).name == PAPERS_SET]
    targets = candidates if regime == NEGATIVE else fit
    order = sorted(targets, key=lambda c: number_of(seed, regime, rooms, c.plan.building, c.plan.name))
    found = []
    for n in range(count if order else 0):
        target, index = order[n % len(order)], n // len(order)
        case = MatchCase(plans=target.plans, plan=target.plan.name, regime=regime, rooms=rooms, index=index, seed=seed)
        if regime == NEGATIVE:
            others = [c for c in fit if c.plan.building != target.plan.building]
            if not others:
                continue
            other = max(others, key=lambda c: number_of(case.key, c.plan.building, c.plan.name))
            case = case.model_copy(update={"source": (other.plans, other.plan.name)})
        found.append(case)
    return found


def floors_of(graph: SceneGraph, rooms: int | None) -> list[str | None]:
    """The floors with at least `rooms` rooms that have walls (None: at least one), in the graph's order."""
    count: dict[str | None, int] = {}
    for room in graph.rooms:
        if graph.surfaces_of_room[room.id]:
            count[room.floor] = count.get(room.floor, 0) + 1
    return [floor for floor, n in count.items() if n >= (rooms or 1)]


def number_of(*key: object) -> int:
    """A number that depends on these values alone: a hash."""
    return int.from_bytes(blake2b(repr(key).encode(), digest_size=16).digest())


@lru_cache(maxsize=1000)
def _made(name: str) -> Plan:
    kind, _, seed = name.rpartition("_")
    if kind not in KINDS or not seed.isdecimal():
        raise UserError(f"no plan '{name}'; give KIND_SEED with a kind of {', '.join(KINDS)}")
    return generate_plan(kind, int(seed))


@cache
def _plans(path: str, merge_collinear: bool = True) -> dict[str, Plan]:
    found: dict[str, Plan] = {}
    for plan in read_plans(Path(path), merge_collinear=merge_collinear):
        if plan.name in found:
            raise UserError(f"{path}: two plans are named '{plan.name}'; rename one")
        if plan.graph.rooms:
            found[plan.name] = plan
    return found
