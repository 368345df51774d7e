"""Live use at the sensor's pace: how late the answers are, what is dropped, how much memory a long drive takes, and
whether the results are those of a run on the same scans.

Another process plays the part of the driver only in that the scans lie on disk: each is read before it is due, and
handed over when it is.
"""

import json
from collections.abc import Mapping
from multiprocessing import active_children
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, sleep
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import PositiveFloat

from data.trajectory import Trajectory
from evaluation.drives.carried import CarriedCase, CarriedDrive, carried
from evaluation.drives.runs import run_through
from evaluation.drives.sequences import DriveOptions, building_of
from evaluation.harness import Claim, Cost, Record, Study
from evaluation.harness.memory import memory_in_use
from evaluation.metrics.trajectories import error_in_bim
from sgslam.live import Answer, LiveSlam

if TYPE_CHECKING:
    import pandas as pd  # not imported in the process whose memory is measured

LATE_S = 0.1  # the time between two scans of most LiDARs
EVERY_S = 30.0  # s between two samples of the memory


class Choice(DriveOptions):
    """Drives of `seconds` by each of `carriers` with each of `sensors`; if `offline`, compared with a run."""

    sequences: tuple[str, ...] = ("institute", "office")
    seeds: tuple[int, ...] = (0,)
    carriers: tuple[str, ...] = ("wheeled", "handheld")
    sensors: tuple[str, ...] = ("VLP-16", "Mid-360")
    seconds: PositiveFloat = 300.0
    offline: bool = True


class LiveCase(CarriedCase):
    """A drive whose scans come as they are measured; if `offline`, a run on them is compared."""

    offline: bool


class Memory(Record):
    """MB in use by the process that tracks and by the one that maps, so many seconds after the first scan."""

    seconds: float
    tracking: float
    mapping: float


class Played(Record):
    """Answers within the time from the instant at which a scan was due: the median, 99 % and all of them (ms), and how
    many took longer than `LATE_S`. At most `most_waiting` scans waited for the map. `dropped` scans have no pose in the
    end.

    RMSE (m) in the BIM frame of the answers with a place in the building (`placed`), and of the trajectory in the end;
    None without an anchor. `offline_m` is the largest distance between a pose of the trajectory and that of a run."""

    scans: int
    points: float
    p50_ms: Cost
    p99_ms: Cost
    longest_ms: Cost
    late: Cost
    most_waiting: Cost
    dropped: int
    finish_s: Cost
    answers_m: Annotated[float | None, "cost"]
    final_m: float | None
    offline_m: float | None
    memory: Annotated[tuple[Memory, ...], "cost"]
    placed: Annotated[int | None, "cost"] = None


def cases(options: Choice) -> list[LiveCase]:
    """Every combination, in each drive."""
    return [
        LiveCase(
            sequence=spec, seed=seed, carrier=carrier, sensor=sensor, seconds=options.seconds, offline=options.offline
        )
        for carrier in options.carriers for sensor in options.sensors for spec, seed in options.drives()
    ]  # fmt: skip


def measure(case: LiveCase, work: Path) -> Played:
    """Simulates the whole drive, then plays it. Raises UserError as the simulator does."""
    bim, _ = building_of(case.sequence, work)
    with carried(case, work) as drive, TemporaryDirectory(dir=work) as out:
        with LiveSlam(out, bim) as live:
            answers, late_s, points, memory = _play(live, drive)
            began = perf_counter()
            live.finish()
            finish_s = perf_counter() - began
        final = Trajectory.read_tum(Path(out) / "trajectory.tum")
        anchored = bool(json.loads((Path(out) / "metrics.json").read_text())["anchored"])
        offline_m = _farthest_from_run(final, drive, bim) if case.offline else None
        placed = _placed(answers)
        return Played(
            scans=drive.count, points=points, p50_ms=1000 * float(np.median(late_s)),
            p99_ms=1000 * float(np.percentile(late_s, 99)), longest_ms=1000 * float(late_s.max()),
            late=int((late_s > LATE_S).sum()), most_waiting=max(answer.waiting for answer in answers),
            dropped=drive.count - len(final), finish_s=finish_s, answers_m=_rmse(placed, drive),
            placed=0 if placed is None else len(placed),
            final_m=_rmse(final, drive) if anchored else None, offline_m=offline_m, memory=memory,
        )  # fmt: skip


def _play(live: LiveSlam, drive: CarriedDrive) -> tuple[list[Answer], NDArray[np.float64], float, tuple[Memory, ...]]:
    """The answers, the seconds (N,) from the instant at which each scan was due to its answer, the mean number of
    points, and samples of the memory."""
    answers, late_s, points, memory = list[Answer](), list[float](), list[int](), list[Memory]()
    began, first_ns = perf_counter() + drive.period_s, int(drive.truth.stamps_ns[0])
    for scan in drive.scans():
        due = began + (scan.stamp_ns - first_ns) / 1e9
        if due > (now := perf_counter()):
            sleep(due - now)
        answers.append(live.add_scan(scan.stamp_ns, scan.points, scan.point_times))
        late_s.append(perf_counter() - due)
        points.append(len(scan.points))
        if due - began >= EVERY_S * len(memory):
            memory.append(_memory(due - began))
    return answers, np.array(late_s), float(np.mean(points)), tuple(memory)


def _memory(seconds: float) -> Memory:
    mapping = sum(memory_in_use(own.pid) for own in active_children() if own.pid is not None)
    return Memory(seconds=seconds, tracking=memory_in_use(), mapping=mapping)


def _placed(answers: list[Answer]) -> Trajectory | None:
    """T_bim_sensor of the answers with a place in the building; None without any."""
    found = {answer.stamp_ns: answer.T_bim_sensor for answer in answers if answer.T_bim_sensor is not None}
    return Trajectory(np.array(list(found), np.int64), np.stack(list(found.values()))) if found else None


def _rmse(found: Trajectory | None, drive: CarriedDrive) -> float | None:
    return None if found is None else error_in_bim(found, drive.truth).position.rmse


def _farthest_from_run(final: Trajectory, drive: CarriedDrive, bim: Path) -> float:
    """The largest distance (m) between a pose and that of a run on the same scans, at the scans that both place."""
    from data.plans import load_bim
    from sgslam.slam import SceneGraphSlam

    whole = run_through(SceneGraphSlam(load_bim(bim)), drive.scans()).trajectory
    return error_in_bim(final, whole).position.max


def tables(rows: "pd.DataFrame") -> Mapping[str, "pd.DataFrame"]:
    """A line for each drive, and the memory along it."""
    import pandas as pd

    from evaluation.harness.tables import of

    drive = ["building", "carrier", "sensor", "seconds"]
    rows = rows.rename(columns={"sequence.name": "building"}).assign(seconds=rows.seconds.map("{:g}".format))
    answers = rows[[*drive, "points", "p50_ms", "p99_ms", "longest_ms", "late", "dropped", "most_waiting"]].copy()
    for name in ("points", "p50_ms", "p99_ms", "longest_ms", "late", "most_waiting"):
        answers[name] = rows[name].map("{:.0f}".format)
    poses = rows[[*drive, "answers_m", "final_m", "offline_m"]].assign(finish_s=rows.finish_s.map("{:.0f}".format))
    placed = rows.reindex(columns=["placed"]).placed
    poses.insert(5, "placed", [of(n, scans) if n >= 0 else "-" for n, scans in zip(placed, rows.scans, strict=True)])
    poses.insert(7, "kept", [of(scans - n, scans) for n, scans in zip(rows.dropped, rows.scans, strict=True)])
    memory = pd.DataFrame([
        {**{name: row[name] for name in drive}, **_memory_along(row.memory)} for _, row in rows.iterrows()
    ])  # fmt: skip
    return {
        "answers": answers.rename(columns=ANSWERS), "memory": memory,
        "poses": poses.round(4).rename(columns=POSES),
    }  # fmt: skip


def claims(rows: "pd.DataFrame") -> list[Claim]:
    """How late answers are, and whether scans are dropped."""
    late, cases = ", ".join(f"{late:.0f}" for late in rows.p99_ms), f"{len(rows)} drives, {rows.scans.sum()} scans"
    text = "Live: time from the instant at which a scan is due to its answer, 99 % of a drive's answers (ms)"
    return [Claim(text, late, cases), Claim("Live: scans that are dropped", str(rows.dropped.sum()), cases)]


ANSWERS = {
    "points": "points a scan", "p50_ms": "median (ms)", "p99_ms": "99 % (ms)", "longest_ms": "longest (ms)",
    "late": "later than 100 ms", "most_waiting": "scans that waited at most",
}  # fmt: skip
POSES = {
    "answers_m": "answers: RMSE (m)", "placed": "answers: coverage", "final_m": "in the end: RMSE (m)",
    "kept": "in the end: coverage", "offline_m": "farthest from a run (m)",
    "finish_s": "to finish (s)",
}  # fmt: skip
PARTS = 6  # of a drive


def _memory_along(samples: list[dict[str, float]]) -> dict[str, str]:
    """Of both processes at the ends of equal parts of the drive."""
    marks = sorted({round(x) for x in np.linspace(0, len(samples) - 1, PARTS + 1)[1:]})
    return {
        f"{part}/{len(marks)} of the drive (MB)": f"{samples[mark]['tracking']:.0f} + {samples[mark]['mapping']:.0f}"
        for part, mark in enumerate(marks, 1)
    }


STUDY = Study(
    "live", "how late live answers are, what is dropped, and how much memory a long drive takes",
    Choice, Choice(sequences=("office",), carriers=("handheld",), sensors=("Mid-360",), seconds=60.0),
    LiveCase, Played, cases, measure, tables, claims, timed=True,
)  # fmt: skip
