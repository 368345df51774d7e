"""Drives over several storeys, or from a start on each storey.

    python -m evaluation.studies.storeys --out DIR --bim FILE --climb A B

`--starts`: a drive on each storey without an initial pose, and how much had to be seen until the storey was known.

Drives and rows are stored in DIR; those that exist already are not run again.
"""

import argparse
import json
from collections import Counter
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from data.common.cli import Parser, run_command
from data.common.errors import UserError
from data.common.files import write_atomically, write_json
from data.scene_graph import SceneGraph
from data.trajectory import Trajectory
from evaluation.harness.benchmark_page import made_by, write_section
from evaluation.drives.sequences import storey_of
from sgslam.config import Config, MatchingSettings
from sgslam.session import Result

WRONG_M = 1.0  # error of the newest pose in the BIM frame above which the place is wrong
WRONG_STOREY_M = 1.5  # error of its height above which the storey is wrong


@dataclass(frozen=True, kw_only=True)
class Row:
    """One drive over `storeys`.

    `wrong_storey`, `wrong_place`: whether the run was anchored to a wrong one at any scan. `unique_m`, `unique_rooms`:
    metres driven and rooms entered at the first anchor; None without one. `floors` and `rooms` are the map's;
    `on_their_floor` counts the rooms on the right floor. `rmse_m` and `max_m` are over all scans in the BIM frame.
    """

    building: str
    storeys: tuple[str, ...]
    seed: int
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


def measure(
    bim: Path, drives: list[tuple[str, ...]], seeds: list[int], size: tuple[int, float], out: Path, config: Config
) -> list[Row]:
    """A row for each drive and seed; `size` is the number of rooms to enter and the metres to drive on each storey.

    Raises UserError as the simulator and the readers do.
    """
    rows = []
    for storeys in drives:
        for seed in seeds:
            name = "-".join([bim.stem, *(s.replace(" ", "").replace(".", "") for s in storeys), str(seed)])
            path = out / f"{name}.json"
            if not path.exists():
                write_json(path, asdict(_measured(bim, storeys, seed, size, out / name, config)))
            row = _read(path)
            rows.append(row)
            print(_summary(row), flush=True)
    return rows


def _read(path: Path) -> Row:
    value = json.loads(path.read_text())
    if set(value) != {f.name for f in fields(Row)}:
        raise UserError(f"{path}: has other columns than this version writes; give another --out")
    return Row(**{**value, "storeys": tuple(value["storeys"])})


def _measured(
    bim: Path, storeys: tuple[str, ...], seed: int, size: tuple[int, float], drive: Path, config: Config
) -> Row:
    from data.plans import load_bim
    from data.scans import ScanFolder
    from data.simulation.simulate import simulate
    from sgslam.slam import SceneGraphSlam

    if not drive.exists():
        simulate(bim, storeys, drive, seed=seed, min_rooms=size[0], min_length=size[1])
    truth = Trajectory.read_tum(drive / "truth.tum")
    driven = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(truth.positions, axis=0), axis=1))])
    description = json.loads((drive / "run.json").read_text())
    a_graph = load_bim(bim).graph
    slam = SceneGraphSlam(a_graph, config=config)
    first, off = None, []
    for k, scan in enumerate(ScanFolder(drive / "scans")):
        update = slam.add_scan(scan.stamp_ns, scan.points)
        if update.anchored and slam.T_bim_map is not None:
            first = k if first is None else first
            off.append((slam.T_bim_map @ update.T_map_sensor)[:3, 3] - truth.positions[k])
    result = slam.finish()
    if result.anchored:
        off.append(result.trajectory.positions[-1] - truth.positions[-1])
        first = len(truth) - 1 if first is None else first
    away = np.array(off).reshape(-1, 3)
    seconds = (truth.stamps_ns - truth.stamps_ns[0]) / 1e9
    seen = [r for r in description["rooms"] if first is not None and r["entered_s"] <= seconds[first]]
    on_floor, rooms = _on_their_floor(result, a_graph, truth)
    rmse, largest, on_stair = _errors(result, a_graph, truth, description["sensor_height_m"])
    return Row(
        building=bim.stem, storeys=storeys, seed=seed,
        status="none" if result.matches is None else result.matches["status"],
        length_m=float(driven[-1]), entered=int(description["rooms_entered"]),
        wrong_storey=bool((np.abs(away[:, 2]) > WRONG_STOREY_M).any()),
        wrong_place=bool((np.linalg.norm(away, axis=1) > WRONG_M).any()),
        unique_m=None if first is None else float(driven[first]),
        unique_rooms=None if first is None else len({r["id"] for r in seen}),
        floors=len(result.s_graph.floors), rooms=rooms, on_their_floor=on_floor, rmse_m=rmse, max_m=largest,
        stair_rmse_m=on_stair,
    )  # fmt: skip


def _on_their_floor(result: Result, a_graph: SceneGraph, truth: Trajectory) -> tuple[int, int]:
    """The number of the map's rooms whose floor is placed on their true storey, and the number of all rooms."""
    placed = {} if result.matches is None else result.matches.get("floors", {})
    rows = {int(stamp): k for k, stamp in enumerate(truth.stamps_ns.tolist())}
    true: dict[str, Counter[str | None]] = {}
    for keyframe in result.s_graph.keyframes:
        if keyframe.room is not None and keyframe.stamp_ns in rows:
            storey = storey_of(a_graph, truth.poses[rows[keyframe.stamp_ns]])
            true.setdefault(keyframe.room, Counter())[storey] += 1
    right = 0
    on_floor: dict[str | None, Counter[str | None]] = {}
    floor_of = {room.id: room.floor for room in result.s_graph.rooms}
    for room_id, seen in true.items():
        on_floor.setdefault(floor_of[room_id], Counter()).update(seen)
    for room in result.s_graph.rooms:  # a room that was only looked into is on the storey of its floor
        storeys = true.get(room.id) or on_floor.get(room.floor) or Counter()
        right += bool(storeys) and result.anchored and placed.get(room.floor or "") == storeys.most_common(1)[0][0]
    return right, len(result.s_graph.rooms)


def _errors(
    result: Result, a_graph: SceneGraph, truth: Trajectory, height: float
) -> tuple[float | None, float | None, float | None]:
    """RMSE, largest error, and RMSE on the stairs alone (m), in the BIM frame."""
    if not result.anchored:
        return None, None, None
    error = np.linalg.norm(result.trajectory.positions - truth.positions, axis=1)
    levels = np.array([f.elevation for f in a_graph.floors if f.elevation is not None])
    ground = truth.positions[:, 2] - height
    stair = np.abs(ground[:, None] - levels).min(axis=1) > 0.15
    on_stair = float(np.sqrt(np.mean(error[stair] ** 2))) if stair.any() else None
    return float(np.sqrt(np.mean(error**2))), float(error.max()), on_stair


def table(rows: list[Row]) -> str:
    """Markdown tables: a line for each drive over several storeys, and for each storey over its starts."""
    climbs, starts = [r for r in rows if len(r.storeys) > 1], [r for r in rows if len(r.storeys) == 1]
    parts = []
    if climbs:
        head = ("building", "storeys", "seed", "driven (m)", "floors", "rooms on their floor", "RMSE (m)",
                "on stairs (m)", "largest (m)", "wrong storey")  # fmt: skip
        lines = [[
            r.building, ", ".join(r.storeys), str(r.seed), f"{r.length_m:.0f}", str(r.floors),
            f"{r.on_their_floor}/{r.rooms}", _metres(r.rmse_m), _metres(r.stair_rmse_m), _metres(r.max_m),
            "yes" if r.wrong_storey else "no",
        ] for r in climbs]  # fmt: skip
        parts.append(_markdown(head, lines))
    if starts:
        head = ("building", "storey", "starts", "wrong storey committed", "wrong place committed", "unique",
                "rooms until unique", "metres until unique", "ambiguous", "none")  # fmt: skip
        groups: dict[tuple[str, ...], list[Row]] = {}
        for r in starts:
            groups.setdefault((r.building, *r.storeys), []).append(r)
        groups["all", ""] = starts
        parts.append(_markdown(head, [[*name, *_starts(own)] for name, own in groups.items()]))
    return "\n".join(parts)


def _starts(own: list[Row]) -> list[str]:
    unique = [r for r in own if r.unique_m is not None]
    rooms, metres = [r.unique_rooms or 0 for r in unique], [r.unique_m or 0.0 for r in unique]
    kinds = Counter(r.status for r in own if r.unique_m is None)
    return [
        str(len(own)), str(sum(r.wrong_storey for r in own)), str(sum(r.wrong_place for r in own)), str(len(unique)),
        f"{np.median(rooms):.0f} ({min(rooms)} to {max(rooms)})" if unique else "",
        f"{np.median(metres):.0f} ({min(metres):.0f} to {max(metres):.0f})" if unique else "",
        str(kinds["ambiguous"]), str(kinds["none"]),
    ]  # fmt: skip


def _markdown(head: tuple[str, ...], lines: list[list[str]]) -> str:
    rows = [head, ("---",) * len(head), *lines]
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def _metres(value: float | None) -> str:
    return "not anchored" if value is None else f"{value:.4f}"


def _summary(r: Row) -> str:
    unique = "never unique" if r.unique_m is None else f"unique after {r.unique_m:.0f} m, {r.unique_rooms} rooms"
    return (
        f"{r.building} {', '.join(r.storeys)} seed {r.seed}: {r.status}, {unique}; RMSE {_metres(r.rmse_m)}, "
        f"{r.on_their_floor}/{r.rooms} rooms on their floor{'; WRONG STOREY' if r.wrong_storey else ''}"
    )


def _parser() -> argparse.ArgumentParser:
    about = "Measure drives over several storeys, or from a start on each storey."
    parser = Parser(prog="python -m evaluation.studies.storeys", description=about)
    add = parser.add_argument
    add("--out", type=Path, required=True, metavar="DIR", help="folder for storeys.md, rows and drives")
    add("--bim", type=Path, metavar="FILE", help="IFC file (default: the demo building)")
    add("--climb", nargs="+", metavar="NAME", help="storeys in the order of the drive (demo building: both)")
    add("--starts", action="store_true", help="a drive on each storey instead, without an initial pose")
    add("--seeds", nargs="+", type=int, default=[0, 1, 2], metavar="N", help="seeds of the drives (default 0 1 2)")
    add("--min-rooms", type=int, default=4, metavar="N", help="rooms to enter on each storey (default 4)")
    add("--min-length", type=float, default=30.0, metavar="M", help="metres to drive on each storey (default 30)")
    add("--method", default=MatchingSettings().method, metavar="NAME", help="matching method (default %(default)s)")
    add("--benchmarks", type=Path, metavar="FILE", help="page of results; its section 'storeys' is written")
    return parser


def main() -> int:
    """The command line."""
    from data.plans import load_bim

    options = _parser().parse_args()
    if options.starts and options.climb:
        raise UserError("--starts and --climb: give only one of them")
    options.out.mkdir(parents=True, exist_ok=True)
    bim = options.bim or _demo(options.out)
    drives: list[tuple[str, ...]]
    if options.starts:
        graph = load_bim(bim).graph
        drives = [(f.name or f.id,) for f in graph.floors if graph.on_floor(f.id).rooms]
    elif options.climb or options.bim is None:
        from data.generation.demo_building import DEMO_STOREYS

        drives = [tuple(options.climb or DEMO_STOREYS)]
    else:
        raise UserError("--climb is missing; name the storeys in the order of the drive, or give --starts")
    config = Config(matching=MatchingSettings(method=options.method))
    size = options.min_rooms, options.min_length
    text = table(measure(bim, drives, options.seeds, size, options.out, config))
    write_atomically(options.out / "storeys.md", f"# Storeys\n\n{text}")
    print(text)
    if options.benchmarks is not None:
        made = made_by(f"python -m evaluation.studies.storeys --out {options.out.name}")
        write_section(options.benchmarks, "storeys", f"## Storeys\n\n{_ABOUT}\n\n{text}\nBy {made}.")
    return 0


def _demo(out: Path) -> Path:
    from data.generation.demo_building import write_demo_building

    bim = out / "demo.ifc"
    if not bim.exists():
        write_demo_building(bim)
    return bim


_ABOUT = (
    "RMSE in building coordinates over all scans, stairs included, without alignment; the run gets only scans and "
    "building. Wrong storey: anchored at any scan with a height error of more than "
    f"{WRONG_STOREY_M:g} m; wrong place: with a position error of more than {WRONG_M:g} m."
)


if __name__ == "__main__":
    run_command(main)
