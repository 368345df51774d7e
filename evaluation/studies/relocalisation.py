"""Relocalisation of a second run in the map of a first run: how soon, and how accurate.

    python -m evaluation.studies.relocalisation --out DIR

Two drives of one building. The first run saves its map; the second gets no initial pose. The second drive is entered
at several places, each in another room. With the building's plan both runs are anchored to it; without the plan, the
first run's S-graph serves as the plan. The CSV has a line for each second run; lines that exist already are skipped.
"""

import argparse
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from data.common.cli import Parser, run_command
from data.common.errors import UserError
from data.common.files import write_atomically
from data.scans import ScanFolder
from data.trajectory import Trajectory
from evaluation.harness import (
    Sequence,
    SequenceSpec,
    prepare,
    read_records,
    read_specs,
    select_sequences,
    write_records,
)
from evaluation.harness.benchmark_page import made_by, write_section
from evaluation.harness.record_file import Record
from evaluation.drives.sequences import storey_of
from evaluation.metrics.rooms_seen import RoomsNeeded, rooms_entered, rooms_needed, rooms_seen
from evaluation.metrics.trajectories import ape
from matching import Matcher
from sgslam.config import Config, MatchingSettings
from sgslam.geometry.frames import inverse
from sgslam.mapping.keyframe_clouds import FILE as CLOUDS
from sgslam.session import Checkpoints, PriorMap
from sgslam.session.checkpoints import FILE
from sgslam.slam import SceneGraphSlam

Array = NDArray[np.float64]
DEMO = [SequenceSpec("demo", "demo", min_rooms=6, min_length=50.0)]
WRONG = 0.5, np.radians(5)  # m and rad off the true pose; beyond, the run was relocalised at a wrong place
STARTS = (0.0, 0.3, 0.6)  # shares of the second drive at which it is entered


@dataclass(frozen=True, kw_only=True)
class Row:
    """A second run that enters its drive at `start`.

    `entered` and `seen` count rooms, `metres` and `seconds` the effort, up to the final relocalisation. If the run was
    not relocalised, `entered` counts all rooms and the others are None. `known`: how many of the rooms entered are in
    the plan; a first map holds the rooms that the first run had entered or mostly seen. `needed` and `needed_sure`: how
    many rooms the matching benchmark needs from the start room on (see `RoomsNeeded`). `common`: how many of the rooms
    entered by the end were also entered by the first run. `wrong`: the share of scans with a wrong pose. `rmse_after_m`
    is over the final poses after relocalisation; `rmse_first_*_m` are the first run's, before and after the merge.
    """

    sequence: str
    plan: str
    first: int
    second: int
    start: float
    found: bool
    needed: int | None
    needed_sure: int | None
    entered: int
    seen: int | None
    known: int
    common: int
    metres: float | None
    seconds: float | None
    driven: float
    wrong: float
    rmse_after_m: float | None
    rmse_m: float | None
    rmse_first_before_m: float
    rmse_first_after_m: float | None
    rooms_first: int
    rooms_both: int


COLUMNS = tuple(f.name for f in fields(Row))


def measure(
    specs: list[SequenceSpec], seeds: list[int], plans: list[str], starts: list[float], out: Path, config: Config
) -> list[Record]:
    """Runs what `out`/relocalisation.csv lacks; returns all requested records."""
    out.mkdir(parents=True, exist_ok=True)
    path, requested = out / "relocalisation.csv", []
    records = read_records(path, COLUMNS)
    for spec in specs:
        for first, second in zip(seeds, [*seeds[1:], seeds[0]], strict=True):
            for plan in plans:
                for start in starts:
                    key = (spec.name, plan, str(first), str(second), str(start))
                    requested.append(key)
                    if any(_key(r) == key for r in records):
                        continue
                    row = _row(prepare(spec, first, out), prepare(spec, second, out), plan, start, out, config)
                    records.append(_record(row))
                    write_records(path, COLUMNS, records)
                    print(", ".join(f"{k} {v}" for k, v in records[-1].items()), flush=True)
    return [r for r in records if _key(r) in set(requested)]


def _row(first: Sequence, second: Sequence, plan: str, start: float, out: Path, config: Config) -> Row:
    folder, before = _first_run(first, plan, out, config)
    known = PriorMap.load(folder, config)
    first_graph = known.floors.graph(known.backend.keyframes, [f.scene for f in known.floors.maps if f.scene])
    T_bim_known = known.T_bim_map
    if T_bim_known is None:  # best fit to the truth: the pose of the first map in the BIM frame is not known
        T_bim_known = ape(before, first.truth, "se3").T_truth_estimate
    slam = SceneGraphSlam(second.a_graph if plan == "bim" else None, config=config, prior=known)
    monitor = _RunMonitor(slam, second.truth, T_bim_known)
    scans = list(ScanFolder(second.scan_dir))
    for scan in scans[int(start * len(scans)) :]:
        monitor.add(scan.stamp_ns, slam.add_scan(scan.stamp_ns, scan.points).T_map_sensor)
    s_graph = slam.s_graph()
    result = slam.finish()
    assert result.relocalisation is not None
    floor = second.a_graph.on_floor(storey_of(second.a_graph, second.truth.poses[0]) or second.a_graph.floors[0].id)
    room = rooms_entered(floor, np.array(monitor.places))[:1]
    entered = [set(rooms_entered(floor, places)) for places in (np.array(monitor.places), first.truth.positions)]
    held = set(floor.room_by_id)
    if plan == "map":
        held = rooms_seen(first_graph, floor, T_bim_known, first.truth.positions)
    seen = monitor.relocalised or monitor.state(s_graph)
    found, after = result.relocalisation.found, seen.stamp_ns
    T = np.eye(4) if result.anchored else T_bim_known
    matcher = Matcher.load(config.matching.method)
    needed = rooms_needed(second.a_graph, room[0], matcher) if room else RoomsNeeded()
    return Row(
        sequence=first.name, plan=plan, first=first.seed, second=second.seed, start=start, found=found,
        needed=needed.most, needed_sure=needed.sure, entered=len(rooms_entered(floor, seen.places)),
        seen=len(rooms_seen(seen.s_graph, floor, seen.T_bim_map, seen.places)) if found else None,
        known=len(set(rooms_entered(floor, seen.places)) & held), common=len(entered[0] & entered[1]),
        metres=seen.metres if found else None,
        seconds=(after - monitor.began_ns) / 1e9 if found else None, driven=monitor.driven,
        wrong=monitor.wrong / max(monitor.scans, 1),
        rmse_after_m=_rmse(result.trajectory, second.truth, T, after) if found else None,
        rmse_m=_rmse(result.trajectory, second.truth, T) if found else None,
        rmse_first_before_m=_rmse(before, first.truth, T_bim_known if plan == "map" else np.eye(4)),
        rmse_first_after_m=_rmse(result.earlier[0], first.truth, T) if found else None,
        rooms_first=len(first_graph.rooms), rooms_both=len(result.s_graph.rooms),
    )  # fmt: skip


def _first_run(sequence: Sequence, plan: str, out: Path, config: Config) -> tuple[Path, Trajectory]:
    """The folder of the first run's map, and its trajectory; in the BIM frame if `plan` is `bim`."""
    folder = out / "maps" / f"{sequence.name}-{sequence.seed}-{plan}"
    if not (folder / FILE).is_file():
        folder.mkdir(parents=True, exist_ok=True)
        slam = SceneGraphSlam(sequence.a_graph if plan == "bim" else None, config=config)
        for scan in ScanFolder(sequence.scan_dir):
            slam.add_scan(scan.stamp_ns, scan.points)
        result = slam.finish()
        if plan == "bim" and not result.anchored:
            raise UserError(f"'{sequence.name}' seed {sequence.seed}: the first run could not be anchored")
        result.trajectory.write_tum(folder / "trajectory.tum")
        result.clouds.copy_to(folder / CLOUDS)
        Checkpoints(folder, {}).write(slam, {}, finished=True)
    return folder, Trajectory.read_tum(folder / "trajectory.tum")


@dataclass(frozen=True, eq=False)
class _MapState:
    """A run at one scan: its stamp, the metres driven, the true positions (N, 3) up to it in the BIM frame, the
    S-graph, and the true pose `T_bim_map` (4, 4) of the map."""

    stamp_ns: int
    metres: float
    places: Array
    s_graph: SceneGraph
    T_bim_map: Array


class _RunMonitor:
    """Follows a second run. `relocalised` is its state at the final relocalisation, None before; `wrong` counts the
    scans with a wrong pose."""

    def __init__(self, slam: SceneGraphSlam, truth: Trajectory, T_bim_known: Array) -> None:
        self._slam, self._truth, self._T_known_bim = slam, truth, inverse(T_bim_known)
        self.scans = self.wrong = 0
        self.driven, self.stamp_ns, self.began_ns = 0.0, 0, 0
        self.T_bim_map = np.eye(4)
        self.places: list[Array] = []
        self.relocalised: _MapState | None = None

    def add(self, stamp_ns: int, T_map_sensor: Array) -> None:
        """Adds a scan with the pose (4, 4) that the run estimates for it."""
        true = self._truth.poses[int(np.abs(self._truth.stamps_ns - stamp_ns).argmin())]
        self.began_ns = self.began_ns if self.scans else stamp_ns
        self.scans, self.stamp_ns = self.scans + 1, stamp_ns
        self.driven += float(np.linalg.norm(true[:3, 3] - self.places[-1])) if self.places else 0.0
        self.T_bim_map = true @ inverse(T_map_sensor)
        self.places.append(true[:3, 3])
        T_prior_map = self._slam.T_prior_map
        if T_prior_map is None:
            self.relocalised = None
            return
        if self.relocalised is None:
            self.relocalised = self.state(self._slam.s_graph())
        off = inverse(self._T_known_bim @ true) @ T_prior_map @ T_map_sensor
        turned = abs(np.arctan2(off[1, 0], off[0, 0]))
        self.wrong += bool(np.linalg.norm(off[:3, 3]) > WRONG[0] or turned > WRONG[1])

    def state(self, s_graph: SceneGraph) -> _MapState:
        """The state at the newest scan, with the S-graph of that scan."""
        return _MapState(self.stamp_ns, self.driven, np.array(self.places), s_graph, self.T_bim_map)


def _rmse(run: Trajectory, truth: Trajectory, T_bim_run: Array, since_ns: int | None = None) -> float:
    """RMSE (m) of a run's positions, taken to the BIM frame by `T_bim_run`, from the stamp `since_ns` on."""
    own = run.stamps_ns >= (run.stamps_ns[0] if since_ns is None else since_ns)
    places = np.abs(truth.stamps_ns[None] - run.stamps_ns[own][:, None]).argmin(axis=1)
    off = run.transformed(T_bim_run).positions[own] - truth.positions[places]
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


def table(records: list[Record]) -> str:
    """Markdown table: a line for each sequence and plan, over all of its second runs."""
    head = ("building", "plan", "runs", "found", "never wrong", "rooms needed by most maps",
            "by 95 %", "rooms entered until found", "of them in the plan", "entered or mostly seen",
            "no more than needed by most maps", "by 95 %", "metres until found",
            "RMSE after (m), mean", "worst", "RMSE of the first run, before", "after")  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    groups: dict[tuple[str, str], list[Record]] = {}
    for r in records:
        groups.setdefault((r["sequence"], r["plan"]), []).append(r)
    for (sequence, plan), own in groups.items():
        found = [r for r in own if r["found"] == "True"]
        after = _numbers(found, "rmse_after_m")
        lines.append("| " + " | ".join([
            sequence, "the BIM" if plan == "bim" else "the first map", str(len(own)), str(len(found)),
            f"{sum(float(r['wrong']) == 0 for r in own)}/{len(own)}",
            _spread(_numbers(own, "needed"), "{:.0f}"), _spread(_numbers(own, "needed_sure"), "{:.0f}"),
            _spread(_numbers(found, "entered"), "{:.0f}"), _spread(_numbers(found, "known"), "{:.0f}"),
            _spread(_numbers(found, "seen"), "{:.0f}"), _within(found, "needed"), _within(found, "needed_sure"),
            _spread(_numbers(found, "metres"), "{:.0f}"),
            f"{np.mean(after):.3f}" if after else "", f"{max(after):.3f}" if after else "",
            f"{np.mean(_numbers(found, 'rmse_first_before_m')):.3f}" if found else "",
            f"{np.mean(_numbers(found, 'rmse_first_after_m')):.3f}" if found else "",
        ]) + " |")  # fmt: skip
    return "\n".join(lines) + "\n"


def _numbers(records: list[Record], column: str) -> list[float]:
    return [float(r[column]) for r in records if r[column]]


def runs_table(records: list[Record]) -> str:
    """Markdown table: a line for each second run."""
    head = ("building", "plan", "runs", "start", "rooms needed by most maps", "by 95 %",
            "entered until found, or in all", "of them in the plan", "entered or mostly seen", "metres",
            "placed wrongly", "RMSE after (m)")  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for r in records:
        after = f"{float(r['rmse_after_m']):.3f}" if r["rmse_after_m"] else "not found"
        metres = f"{float(r['metres']):.0f}" if r["metres"] else ""
        lines.append("| " + " | ".join([
            r["sequence"], "the BIM" if r["plan"] == "bim" else "the first map", f"{r['first']}, {r['second']}",
            r["start"], r["needed"], r["needed_sure"], r["entered"], r["known"], r["seen"], metres,
            f"{100 * float(r['wrong']):.0f} %", after,
        ]) + " |")  # fmt: skip
    return "\n".join(lines) + "\n"


def _within(found: list[Record], needed: str) -> str:
    requested = [r for r in found if r[needed]]
    return f"{sum(int(r['known']) <= int(r[needed]) for r in requested)}/{len(requested)}"


def _spread(values: list[float], form: str) -> str:
    if not values:
        return ""
    low, middle, high = (form.format(value) for value in (min(values), float(np.median(values)), max(values)))
    return f"{middle} ({low} to {high})"


def _key(record: Record) -> tuple[str, ...]:
    return record["sequence"], record["plan"], record["first"], record["second"], record["start"]


def _record(row: Row) -> Record:
    return {name: "" if (value := getattr(row, name)) is None else str(value) for name in COLUMNS}


def _parser() -> argparse.ArgumentParser:
    about = "Measure how soon and how accurately a second run is relocalised in the map of a first run."
    parser = Parser(prog="python -m evaluation.studies.relocalisation", description=about)
    add = parser.add_argument
    add("--out", type=Path, required=True, metavar="DIR", help="folder for the results, maps and drives")
    add("--list", type=Path, metavar="FILE", help="YAML list of sequences (default: the demo building)")
    add("--sequences", nargs="+", metavar="NAME", help="only these of the list")
    add("--seeds", nargs="+", type=int, default=[0, 1, 2], metavar="N", help="seeds of the drives (default 0 1 2)")
    add("--plans", nargs="+", choices=("bim", "map"), default=["bim", "map"], help="plan to use (default: both)")
    about = "shares of the second drive at which it is entered (default %(default)s)"
    add("--starts", nargs="+", type=float, default=list(STARTS), metavar="SHARE", help=about)
    add("--method", default=MatchingSettings().method, metavar="NAME", help="matching method (default %(default)s)")
    add("--benchmarks", type=Path, metavar="FILE", help="page of results; its section 'relocalisation' is written")
    return parser


def main() -> int:
    """The command line."""
    options = _parser().parse_args()
    specs = select_sequences(DEMO if options.list is None else read_specs(options.list), options.sequences)
    if len(options.seeds) < 2 or not all(0 <= start < 1 for start in options.starts):
        raise UserError("--seeds needs at least two drives; --starts needs shares of a drive from 0 to below 1")
    config = Config(matching=MatchingSettings(method=options.method))
    records = measure(specs, options.seeds, options.plans, options.starts, options.out, config)
    text = f"{table(records)}\n{runs_table(records)}"
    write_atomically(options.out / "relocalisation.md", f"# Relocalisation\n\n{text}")
    if options.benchmarks is not None:
        command = f"python -m evaluation.studies.relocalisation --out {options.out.name} --method {options.method}"
        section = f"## Relocalisation\n\n{_ABOUT}\n\n{text}\nBy {made_by(command)}."
        write_section(options.benchmarks, "relocalisation", section)
    print(text)
    return 0


_ABOUT = (
    "A second run without an initial pose in the map of a first run. Its drive is entered at the beginning and further "
    "on, each time in another room. Found: relocalised in the first run's map until the end. Wrong: at any time more "
    "than 0.5 m or 5 degrees off the true pose. The RMSE is over the poses after relocalisation, in the BIM frame, "
    "without alignment of the second run; where the first map is the plan, that map lies at its best fit to the truth. "
    "A room is entered when the robot was in it, mostly seen when the map has more than half of its planned walls by "
    "length; a first map holds the rooms that its run had entered or mostly seen. Needed: the smallest number of rooms "
    "from the start room on at which most of five maps of the matching benchmark (regime real) are matched uniquely "
    "and correctly in the building's plan, and at which at least 95 % of forty are; compared with the rooms entered "
    "that are in the plan."
)


if __name__ == "__main__":
    run_command(main)
