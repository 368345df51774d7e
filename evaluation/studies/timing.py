"""How long a run takes beside other programs, how late live answers are, and whether a long run keeps its pace."""

import os
import resource
import subprocess
import sys
from collections.abc import Mapping
from multiprocessing import active_children
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, sleep
from typing import Any, Literal

import numpy as np
import pandas as pd
from pydantic import PositiveFloat, PositiveInt

from data.common.errors import UserError
from data.common.processes import may_have_children, run_isolated
from data.plans import load_bim
from data.trajectory import Trajectory
from evaluation.drive import Drive, DriveCase, DriveOptions, drive_of, release
from evaluation.metrics.trajectories import error_in_bim
from evaluation.study import Claim, Record, Study
from evaluation.tables import Column, Query, count, spread, spread_of
from sgslam.live.live_slam import LiveSlam
from sgslam.slam import SceneGraphSlam

LATE_S = 0.1  # the time between two scans of most LiDARs
PARTS = 10  # of a drive, at whose ends pace and memory are noted
PIPELINE, RUN, FIRST = "KISS-ICP's own pipeline, its default voxels of 1 m", "sgslam", "sgslam, just installed"
PEER = "import sys, data.scans as d, evaluation.peers.odometries as p; p.{}_alone(d.ScanFolder(sys.argv[1]))"


class Timed(DriveCase):
    """`programs` on a drive's scans, in `turns`; the drive at the sensor's pace (`live`); or in one run (`long`)."""

    what: Literal["programs", "live", "long"]
    turns: int = 1


class Choice(DriveOptions):
    """`turns` of all programs on drives of `seconds`, drives of `live_seconds` in a hand, and of `long_seconds`."""

    buildings: tuple[str, ...] = ("institute", "office")
    seconds: PositiveFloat = 120.0
    turns: PositiveInt = 3
    live_seconds: PositiveFloat = 300.0
    long_seconds: PositiveFloat = 1800.0


def cases(options: Choice) -> list[Timed]:
    """Three of each drive."""
    hand = {"carrier": "handheld", "sensor": "Mid-360", "seconds": options.live_seconds}
    whats: dict[str, dict[str, Any]] = {"programs": {"turns": options.turns}, "live": hand}
    whats["long"] = {"seconds": options.long_seconds}
    return [Timed(**{**drive, **own, "what": what}) for what, own in whats.items() for drive in options.drives()]


def measure(case: Timed, work: Path) -> Record:
    """What the functions below measure, in processes of their own; of `live` also the largest distance (m) from a run
    with one pass on the same scans."""
    drive = drive_of(case, work)
    if case.what == "programs":
        return {"scans": drive.count, "programs": programs(drive, case.turns)}
    record, poses = run_isolated(fed, drive, case.what == "live", what=case.what)
    if case.what == "live":
        _, run = run_isolated(fed, drive, False, what=case.what)
        record["from_run_m"] = error_in_bim(poses, run).position.max
    return record


def programs(drive: Drive, turns: int) -> list[Record]:
    """In each turn, the seconds of each program's whole process, and how many times those of KISS-ICP's pipeline they
    are; in the first turn also of a run with empty caches, as just after installing."""
    scans, plan, found = str(drive.folder.resolve()), str(drive.plan.resolve()), list[Record]()
    run = [sys.executable, "-m", "sgslam.run", "--scan-dir", scans, "--bim", plan, "--out", "out"]
    pipeline = [str(Path(sys.executable).with_name("kiss_icp_pipeline")), "--dataloader", "generic", scans]
    kiss, gicp = ([sys.executable, "-c", PEER.format(name), scans] for name in ("kiss_icp", "small_gicp"))
    _seconds(run)  # fills the caches
    for turn in range(turns):
        times = {RUN: _seconds(run), PIPELINE: _seconds(pipeline)}
        times |= {"KISS-ICP": _seconds(kiss), "small_gicp": _seconds(gicp)}
        if turn == 0:
            with TemporaryDirectory() as empty:
                times[FIRST] = _seconds(run, NUMBA_CACHE_DIR=f"{empty}/loops", SGSLAM_CACHE_DIR=empty)
        found += [{"program": name, "s": s, "times": s / times[PIPELINE]} for name, s in times.items()]
    return [{**one, "pace": drive.count / one["s"]} for one in found]


def _seconds(command: list[str], **environment: str) -> float:
    """From the start of a command to its end. Raises UserError if it fails."""
    where = {**os.environ, "PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path), **environment}
    began = perf_counter()
    with TemporaryDirectory() as folder:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, env=where)
    if done.returncode:
        raise UserError(f"a timed program failed: {' '.join((done.stdout + done.stderr).split()[-30:])}")
    return perf_counter() - began


def fed(drive: Drive, at_pace: bool) -> tuple[Record, Trajectory]:
    """Live use at the sensor's pace, or a run with one pass; and its trajectory. Milliseconds count from when a scan is
    due to its answer; each part of the drive has scans a second, and the memory of this process and of the mapping one.
    """
    may_have_children()
    late_s, parts, part = list[float](), list[Record](), max(1, drive.count // PARTS)
    with TemporaryDirectory() as out:
        slam: Any = LiveSlam(out, drive.plan) if at_pace else SceneGraphSlam(load_bim(drive.plan))
        start = begin = perf_counter()
        for number, scan in enumerate(drive.scans(), 1):  # each is read before it is due
            due = start + drive.period_s + scan.stamp_ns / 1e9 if at_pace else perf_counter()
            sleep(max(0.0, due - perf_counter()))
            slam.add_scan(scan.stamp_ns, scan.points, scan.point_times)
            late_s.append(perf_counter() - due)
            if number % part == 0:
                pace, begin = part / (perf_counter() - begin), perf_counter()
                maps = sum(_memory_mb(child.pid) for child in active_children())
                parts.append({"scan": number, "pace": pace, "memory_mb": _memory_mb("self"), "map_mb": maps})
        found = slam.finish()
        anchored = found["anchored"] if at_pace else found.anchored
        poses = Trajectory.read_tum(Path(out) / "trajectory.tum") if at_pace else found.trajectory
    record: Record = {f"p{share}_ms": 1000 * float(np.percentile(late_s, share)) for share in (50, 99, 100)}
    record |= {"scans": drive.count, "late": sum(s > LATE_S for s in late_s), "dropped": drive.count - len(poses)}
    record |= {"rmse_m": error_in_bim(poses, drive.truth).position.rmse if anchored else None, "parts": parts}
    return record, poses


def _memory_mb(process: int | str | None) -> float:
    """The resident memory of a process."""
    return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * resource.getpagesize() / 2**20


BY, RATE = {"what": "use", "building": "building"}, {"scans a second": spread("pace")}
PROGRAM: dict[str, Column] = {"runs": count(), **RATE, "times KISS-ICP's": spread("times", ".1f")}
PART = {**RATE, "memory (MB)": spread("memory_mb"), "of the map's process (MB)": spread("map_mb")}
DRIVE = {f"{share} % (ms)": spread(f"p{share}_ms") for share in (50, 99, 100)}
DRIVE |= {"later than 100 ms": spread("late"), "not placed": spread("dropped"), "RMSE (m)": spread("rmse_m", ".3f")}
DRIVE |= {"from a run (m)": spread("from_run_m", ".4f")}


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """A line for each program, for each drive that was fed, and for every third part of it."""
    made = {"drives": Query(BY, DRIVE, lambda rows: rows.what != "programs").table(rows)}
    for name, query in {
        "programs": Query({"program": "program"}, PROGRAM),
        "parts": Query({**BY, "scan": "up to scan"}, PART, lambda parts: parts.groupby([*BY]).cumcount() % 3 == 0),
    }.items():
        own = rows[(rows.what == "programs") == (name == "programs")].to_dict("records")
        made |= {name: query.table(pd.json_normalize(own, name, [*BY]))} if own else {}
    return made


def claims(rows: pd.DataFrame) -> list[Claim]:
    """How long a whole run takes, and how late live answers are."""
    lists, live = rows[rows.what == "programs"].get("programs", ()), rows[rows.what == "live"]
    times = pd.Series([one["times"] for turns in lists for one in turns if one["program"] == RUN])
    return [
        Claim("Time of a whole run, times KISS-ICP's pipeline", spread_of(times, ".1f"), f"{len(times)} runs"),
        Claim("Live: 99 % of a drive's answers within (ms)", DRIVE["99 % (ms)"](live), f"{len(live)} drives"),
    ]


STUDY = Study(
    name="timing",
    asks="how long a run takes beside KISS-ICP and small_gicp, how late live answers are, whether a long run keeps up",
    options=Choice,
    quick=Choice(buildings=("demo",), seconds=40.0, turns=1, live_seconds=40.0, long_seconds=120.0),
    case=Timed,
    cases=cases,
    measure=measure,
    tables=tables,
    claims=claims,
    release=release,
    timed=True,
)
