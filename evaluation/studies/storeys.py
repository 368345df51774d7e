"""Drives over several storeys, and from a start on each storey: whether the storey is recognised, and how soon."""

import json
import re
from collections import Counter, defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from data.generation.demo_building import DEMO_STOREYS
from data.plans import load_bim
from data.scans import ScanFolder
from data.scene_graph import SceneGraph
from data.simulation.carriers import CARRIERS, carrier_named
from data.simulation.simulate import simulate
from data.trajectory import Trajectory
from evaluation.drives.buildings import demo_building, locked
from evaluation.drives.sequences import storey_of
from evaluation.harness import Case, Claim, Options, Record, Study
from evaluation.harness.tables import bootstrapped, coverage, grouped, interval, of, rare, spread
from evaluation.metrics.statistics import Statistics
from evaluation.metrics.trajectories import matched
from sgslam.config import Config, MatchingSettings
from sgslam.session import Result
from sgslam.slam import SceneGraphSlam

WRONG_M = 1.0  # error of the newest pose in the BIM frame above which the place is wrong
WRONG_STOREY_M = 1.5  # error of its height above which the storey is wrong
ON_STAIRS_M = 0.15  # height of the ground above or below the nearest storey
ALL = tuple(CARRIERS)
INSTITUTE = "../shared/data/ifc/AC11-Institute-Var-2-IFC.ifc"


class Tour(BaseModel):
    """Storeys of a building, rooms to enter and metres to drive on each of them, and who carries the sensor."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    bim: str = "demo"
    storeys: tuple[str, ...]
    seeds: tuple[int, ...] = (0, 1, 2)
    carriers: tuple[str, ...] = ("wheeled",)
    min_rooms: int = 4
    min_length: float = 30.0


class Choice(Options):
    """`climbs` are drives over all of their storeys in this order; `starts` are a drive on each of their storeys."""

    climbs: tuple[Tour, ...] = (
        Tour(storeys=DEMO_STOREYS, carriers=ALL),
        Tour(bim=INSTITUTE, storeys=("Erdgeschoss", "1. Obergeschoss"), carriers=ALL),
        Tour(bim=INSTITUTE, storeys=("Erdgeschoss", "1. Obergeschoss", "Erdgeschoss"), seeds=(0, 1)),
    )
    starts: tuple[Tour, ...] = (
        Tour(
            bim=INSTITUTE, storeys=("Keller", "Erdgeschoss", "1. Obergeschoss", "2. Obergeschoss", "Dachgeschoss"),
            seeds=(0, 1, 2, 3, 4), min_rooms=5, min_length=35.0,
        ),
    )  # fmt: skip
    method: str = MatchingSettings().method


class StoreyDrive(Case):
    """A drive over `storeys`, without an initial pose."""

    bim: str
    storeys: tuple[str, ...]
    seed: int
    carrier: str
    min_rooms: int
    min_length: float
    method: str

    def files(self) -> set[str]:
        """The building."""
        return {self.bim} - {"demo"}


class Storeys(Record):
    """`wrong_storey`, `wrong_place`: whether the run was anchored to a wrong one at any scan.

    `unique_m`, `unique_rooms`: metres driven and rooms entered at the first anchor; None without one. `floors` and
    `rooms` are the map's; `on_their_floor` counts the rooms on the right floor. The errors (m) are over the anchored
    scans in the BIM frame, and over those on stairs; `coverage` is the share of all scans that the former are over.
    """

    status: str
    length_m: float
    entered: int
    wrong_storey: bool
    wrong_place: bool
    unique_m: float | None
    unique_rooms: int | None
    floors: int
    rooms: int
    on_their_floor: int
    rmse_m: float | None
    max_m: float | None
    stair_rmse_m: float | None
    coverage: float | None = None


def cases(options: Choice) -> list[StoreyDrive]:
    """The drives over several storeys, then the starts on each."""
    chosen = [(tour, tour.storeys) for tour in options.climbs]
    chosen += [(tour, (storey,)) for tour in options.starts for storey in tour.storeys]
    return [
        StoreyDrive(
            bim=tour.bim, storeys=storeys, seed=seed, carrier=carrier, min_rooms=tour.min_rooms,
            min_length=tour.min_length, method=options.method,
        )
        for tour, storeys in chosen for carrier in tour.carriers for seed in tour.seeds
    ]  # fmt: skip


def measure(case: StoreyDrive, work: Path) -> Storeys:
    """Simulates the drive if it is missing, and runs it. Raises UserError as the simulator and the readers do."""
    bim = demo_building(work) if case.bim == "demo" else Path(case.bim)
    drive = _drive(case, bim, work)
    truth, description = Trajectory.read_tum(drive / "truth.tum"), json.loads((drive / "run.json").read_text())
    a_graph = load_bim(bim).graph
    slam = SceneGraphSlam(a_graph, config=Config(matching=MatchingSettings(method=case.method)))
    placed = dict[int, NDArray[np.float64]]()
    for scan in ScanFolder(drive / "scans"):
        update = slam.add_scan(scan.stamp_ns, scan.points, scan.point_times)
        if update.anchored and slam.T_bim_map is not None:
            placed[update.stamp_ns] = slam.T_bim_map @ update.T_map_sensor
    result = slam.finish()
    first_ns = next(iter(placed), int(truth.stamps_ns[-1]) if result.anchored else None)
    away = np.concatenate([_off(Trajectory(np.array([*placed]), np.array([*placed.values()])), truth),
                           _off(result.trajectory, truth)[-1:] if result.anchored else np.empty((0, 3))])  # fmt: skip
    return Storeys(
        status="none" if result.matches is None else result.matches["status"],
        entered=description["rooms_entered"], wrong_storey=bool((np.abs(away[:, 2]) > WRONG_STOREY_M).any()),
        wrong_place=bool((np.linalg.norm(away, axis=1) > WRONG_M).any()), floors=len(result.s_graph.floors),
        rooms=len(result.s_graph.rooms), on_their_floor=rooms_on_their_floor(result, a_graph, truth),
        **_until(first_ns, truth, description["rooms"]),
        **_errors(result, a_graph, truth, description["sensor_height_m"]),
    )  # fmt: skip


def _drive(case: StoreyDrive, bim: Path, work: Path) -> Path:
    """The folder of the drive."""
    parts = (bim.stem, *case.storeys, case.seed, case.carrier, case.min_rooms, f"{case.min_length:g}")
    folder = work / "-".join(re.sub(r"[^\w.-]", "", str(part)) for part in parts)
    with locked(folder):
        if not folder.exists():
            simulate(
                bim, case.storeys, folder, seed=case.seed, min_rooms=case.min_rooms, min_length=case.min_length,
                carrier=carrier_named(case.carrier), effects=("rolling",),
            )  # fmt: skip
    return folder


def _off(estimate: Trajectory, truth: Trajectory) -> NDArray[np.float64]:
    """(M, 3) how far off the poses are that have a true one, in order."""
    if not len(estimate):
        return np.empty((0, 3))
    both = matched(estimate, truth)
    return np.asarray(both.estimate[:, :3, 3] - both.truth[:, :3, 3])


def _until(first_ns: int | None, truth: Trajectory, rooms: list[dict[str, Any]]) -> dict[str, Any]:
    """The length of the drive, and metres and rooms up to the scan at `first_ns`."""
    driven = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(truth.positions, axis=0), axis=1))])
    whole = {"length_m": float(driven[-1])}
    if first_ns is None:
        return whole | {"unique_m": None, "unique_rooms": None}
    second = (first_ns - truth.stamps_ns[0]) / 1e9
    seen = {room["id"] for room in rooms if room["entered_s"] <= second}
    return whole | {"unique_m": float(np.interp(first_ns, truth.stamps_ns, driven)), "unique_rooms": len(seen)}


def rooms_on_their_floor(result: Result, a_graph: SceneGraph, truth: Trajectory) -> int:
    """The number of the map's rooms whose floor is placed on the storey where they were seen from."""
    if result.matches is None or not result.anchored:
        return 0
    placed, rooms = result.matches.get("floors", {}), result.s_graph.rooms
    true = dict(zip(truth.stamps_ns.tolist(), truth.poses, strict=True))
    floor_of = {room.id: room.floor for room in rooms}
    of_room: dict[str, Counter[str | None]] = defaultdict(Counter)
    of_floor: dict[str | None, Counter[str | None]] = defaultdict(Counter)
    for keyframe in result.s_graph.keyframes:
        if keyframe.room is not None and keyframe.stamp_ns in true:
            storey = storey_of(a_graph, true[keyframe.stamp_ns])
            of_room[keyframe.room][storey] += 1
            of_floor[floor_of[keyframe.room]][storey] += 1
    seen = [(room, of_room[room.id] or of_floor[room.floor]) for room in rooms]  # if only looked into: of its floor
    return sum(placed.get(room.floor or "") == own.most_common(1)[0][0] for room, own in seen if own)


def _errors(result: Result, a_graph: SceneGraph, truth: Trajectory, height: float) -> dict[str, float | None]:
    """The errors (m) in the BIM frame, over the anchored scans and on the stairs alone."""
    if not result.anchored or not len(result.trajectory):
        return {"rmse_m": None, "max_m": None, "stair_rmse_m": None}
    both = matched(result.trajectory, truth)
    error = np.linalg.norm(both.estimate[:, :3, 3] - both.truth[:, :3, 3], axis=1)
    levels = np.array([f.elevation for f in a_graph.floors if f.elevation is not None])
    stair = np.abs(both.truth[:, 2, 3, None] - height - levels).min(axis=1) > ON_STAIRS_M
    on_stair = Statistics.of(error[stair]).rmse if stair.any() else None
    return {
        "rmse_m": Statistics.of(error).rmse, "max_m": float(error.max()), "stair_rmse_m": on_stair,
        "coverage": len(error) / len(truth),
    }  # fmt: skip


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """A line for each drive over several storeys; one for each storey over its starts."""
    climbs, starts = _kinds(rows)
    lines = pd.DataFrame({
        "building": climbs.building, "storeys": climbs.storeys.str.join(", "), "carrier": climbs.carrier,
        "seed": climbs.seed,
        "driven (m)": climbs.length_m.map("{:.0f}".format), "floors": climbs.floors,
        "rooms on their floor": climbs.on_their_floor.astype(str) + "/" + climbs.rooms.astype(str),
        "RMSE (m)": climbs.rmse_m.map(_metres), "coverage": [coverage(climbs.loc[[at]]) for at in climbs.index],
        "on stairs (m)": climbs.stair_rmse_m.map(_metres),
        "largest (m)": climbs.max_m.map(_metres), "wrong storey": climbs.wrong_storey.map({True: "yes", False: "no"}),
    })  # fmt: skip
    starts = starts.assign(storey=starts.storeys.str[0])
    each_storey = grouped(starts, ("building", "storey"), _starts)
    total = pd.DataFrame([{"building": "all", "storey": "", **_starts(starts)}])
    return {"climbs": lines, "starts": pd.concat([each_storey, total])}


def _kinds(rows: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The drives over several storeys, and the starts."""
    rows = rows.assign(building=rows.bim.map(lambda bim: Path(bim).stem))
    several = rows.storeys.str.len() > 1
    return rows[several], rows[~several]


def _starts(own: pd.DataFrame) -> dict[str, Any]:
    unique, never = own[own.unique_m.notna()], own[own.unique_m.isna()]
    return {
        "starts": len(own), "wrong storey committed": own.wrong_storey.sum(),
        "wrong place committed": own.wrong_place.sum(), "unique": len(unique),
        "rooms until unique": spread(unique.unique_rooms), "metres until unique": spread(unique.unique_m),
        "ambiguous": (never.status == "ambiguous").sum(), "none": (never.status == "none").sum(),
    }  # fmt: skip


def _metres(value: float | None) -> str:
    return "not anchored" if pd.isna(value) else f"{value:.4f}"


def claims(rows: pd.DataFrame) -> list[Claim]:
    """How often a storey was wrong, and the error of drives over stairs."""
    climbs, _ = _kinds(rows)
    wrong, error = rare(rows.wrong_storey.sum(), len(rows)), bootstrapped(climbs.rmse_m, climbs.building)
    anchored = f"{of(climbs.rmse_m.notna().sum(), len(climbs))} drives anchored, coverage {coverage(climbs)}"
    return [
        Claim("Drives that were ever anchored to a wrong storey", wrong, f"{len(rows)} drives"),
        Claim("RMSE in building coordinates of drives over several storeys, stairs included (mm)",
              interval(error, ".1f", 1000), anchored),
    ]  # fmt: skip


STUDY = Study(
    "storeys", "whether the storey is recognised, and how accurate a drive over stairs is",
    Choice, Choice(climbs=(Tour(storeys=DEMO_STOREYS, seeds=(0,), carriers=ALL),),
                   starts=(Tour(storeys=DEMO_STOREYS, seeds=(0,)),)),
    StoreyDrive, Storeys, cases, measure, tables, claims,
)  # fmt: skip
