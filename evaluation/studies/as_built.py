"""`python -m evaluation.studies.as_built --out DIR`: precision and recall of reported deviations from the plan.

Each building is driven twice per seed: with a share of its walls moved by 10 to 30 cm, and with some walls absent and
some added that the plan lacks. The storey is given, since a similar unchanged storey would explain the map better. The
CSV has a line for each drive and kind of deviation; lines that exist already are skipped.
"""

import argparse
import json
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from data.common.cli import Parser, run_command
from data.common.errors import UserError
from data.common.files import write_atomically
from data.scans import ScanFolder
from data.simulation import Changes
from evaluation.harness import (
    Conditions,
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
from evaluation.metrics.as_built_scores import KINDS, LEAST_VIEWS, deviation_scores
from evaluation.metrics.true_walls import TrueWall, true_walls
from sgslam.config import Config, MatchingSettings

DEMO = [SequenceSpec("demo", "demo", min_rooms=14, min_length=90.0)]
MOVED, GONE = 0.3333, 0.12  # shares of a storey's walls: moved; absent, and as many added
WITHIN_M = 0.03  # of a moved wall's true offset


@dataclass(frozen=True, kw_only=True)
class Row:
    """One kind of deviation in one drive.

    `found` of the `expected` walls were reported; of the `told` reports, `right` are true. `offsets_mm` are the offset
    errors of the moved walls that were found.
    """

    sequence: str
    conditions: str
    seed: int
    kind: str
    anchored: bool
    rmse_bim_m: float | None
    expected: int
    found: int
    told: int
    right: int
    offsets_mm: str
    missed: str
    false: str


COLUMNS = tuple(f.name for f in fields(Row))


def measure(
    specs: list[SequenceSpec], seeds: list[int], shares: tuple[float, float], out: Path, config: Config
) -> list[Record]:
    """Runs what `out`/as_built.csv lacks; returns all requested records.

    `shares` are those of the moved walls, and of the absent and of the added ones; `config` is the runs'. Raises
    UserError as the simulator and the readers do.
    """
    out.mkdir(parents=True, exist_ok=True)
    path = out / "as_built.csv"
    records = read_records(path, COLUMNS)
    requested = []
    for spec in specs:
        if not spec.simulated or spec.is_mesh:
            raise UserError(f"'{spec.name}': not a simulated IFC model; leave it out, only those can be changed")
        for seed in seeds:
            for conditions in _conditions(shares):
                key = (spec.name, conditions.name, str(seed))
                requested.append(key)
                if any(_key(r) == key for r in records):
                    continue
                fresh = [_record(row) for row in _rows(spec, seed, conditions, out, config)]
                records += fresh
                write_records(path, COLUMNS, records)
                print("; ".join(_short(r) for r in fresh), flush=True)
    return [r for r in records if _key(r) in set(requested)]


def _conditions(shares: tuple[float, float]) -> Iterator[Conditions]:
    if shares[0]:
        yield Conditions(moved_walls=shares[0])
    if shares[1]:
        yield Conditions(absent_walls=shares[1], unplanned_walls=shares[1])


def _rows(spec: SequenceSpec, seed: int, conditions: Conditions, out: Path, config: Config) -> Iterator[Row]:
    from evaluation.metrics.trajectories import error_in_bim
    from sgslam.slam import SceneGraphSlam

    sequence = prepare(spec, seed, out, conditions)
    walls = walls_of(spec, sequence)
    storey = storey_of(sequence.a_graph, sequence.truth.poses[0])
    slam = SceneGraphSlam(sequence.a_graph.on_floor(storey), config=config)
    for scan in ScanFolder(sequence.scan_dir):
        slam.add_scan(scan.stamp_ns, scan.points)
    result = slam.finish()
    write_atomically(sequence.scan_dir.parent / "deviations.json", json.dumps(result.deviations, indent=1))
    scores = deviation_scores(result.deviations, result.s_graph, sequence.a_graph, result.T_bim_map, walls)
    rmse = error_in_bim(result.trajectory, sequence.truth).position.rmse if result.anchored else None
    for kind, of_kind in scores.items():
        s = of_kind.score
        yield Row(
            sequence=spec.name, conditions=conditions.name, seed=seed, kind=kind, anchored=result.anchored,
            rmse_bim_m=rmse, expected=s.expected, found=s.found, told=s.answered, right=s.right,
            offsets_mm=" ".join(f"{1000 * e:.1f}" for e in of_kind.offset_errors),
            missed=" ".join(of_kind.missed), false=" ".join(of_kind.false),
        )  # fmt: skip


def walls_of(spec: SequenceSpec, sequence: Sequence) -> list[TrueWall]:
    """The true walls of a drive's storey, with the poses of would-be keyframes as viewpoints."""
    from sgslam.mapping import KeyframeRule

    drive, c = sequence.scan_dir.parent, sequence.conditions
    rule = KeyframeRule(Config().keyframes)
    keyframes = [k for k, pose in enumerate(sequence.truth.poses) if rule.wants(pose)]
    settings = json.loads((drive / "run.json").read_text())
    ifc = drive.parent / settings["bim"] if spec.bim == "demo" else Path(spec.bim)
    changes = Changes(c.moved_walls, c.absent_walls, c.unplanned_walls)
    return true_walls(ifc, settings["storey"], changes, sequence.seed, sequence.truth, keyframes, drive / "walls.json")


def table(records: list[Record]) -> str:
    """Markdown table: a line for each sequence and kind, over its seeds."""
    head = ("sequence", "drives", "walls", "kind", "to find", "recall", "precision", "offset error, median",
            "within 3 cm", "RMSE (m)")  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    groups: dict[tuple[str, str, str], list[Record]] = {}
    for r in records:
        groups.setdefault((r["sequence"], r["conditions"], r["kind"]), []).append(r)
    for (sequence, conditions, kind), own in groups.items():
        offsets = [float(x) for r in own for x in r["offsets_mm"].split()]
        errors = [float(r["rmse_bim_m"]) for r in own if r["rmse_bim_m"]]
        lines.append("| " + " | ".join([
            sequence, str(len(own)), conditions, kind, str(_total(own, "expected")),
            _share(own, "found", "expected"), _share(own, "right", "told"),
            f"{np.median(offsets):.1f} mm" if offsets else "",
            f"{sum(x <= 1000 * WITHIN_M for x in offsets)}/{len(offsets)}" if offsets else "",
            f"{np.mean(errors):.4f}" if errors else "not anchored",
        ]) + " |")  # fmt: skip
    return "\n".join(lines) + "\n"


def _total(records: list[Record], column: str) -> int:
    return sum(int(r[column]) for r in records)


def _share(records: list[Record], part: str, whole: str) -> str:
    a, b = _total(records, part), _total(records, whole)
    return f"{a / b:.2f} ({a}/{b})" if b else ""


def _short(r: Record) -> str:
    where = f"{r['sequence']} seed {r['seed']} {r['conditions']}: " if r["kind"] == "moved" else ""
    return f"{where}{r['kind']} found {r['found']}/{r['expected']}, right {r['right']}/{r['told']}"


def _key(record: Record) -> tuple[str, ...]:
    return record["sequence"], record["conditions"], record["seed"]


def _record(row: Row) -> Record:
    return {name: "" if (value := getattr(row, name)) is None else str(value) for name in COLUMNS}


def _parser() -> argparse.ArgumentParser:
    about = "Measure which deviations of walls from the plan are reported, and how many reports are false."
    parser = Parser(prog="python -m evaluation.studies.as_built", description=about)
    add = parser.add_argument
    add("--out", type=Path, required=True, metavar="DIR", help="folder for as_built.csv, as_built.md and drives")
    add("--list", type=Path, metavar="FILE", help="YAML list of sequences (default: the demo building)")
    add("--sequences", nargs="+", metavar="NAME", help="only these of the list")
    add("--seeds", nargs="+", type=int, default=[0, 1, 2], metavar="N", help="seeds of the drives (default 0 1 2)")
    add("--moved", type=float, default=MOVED, metavar="SHARE", help=f"share of walls moved (default {MOVED})")
    add("--gone", type=float, default=GONE, metavar="SHARE",
        help=f"share of walls absent, and added, each (default {GONE})")  # fmt: skip
    add("--method", default=MatchingSettings().method, metavar="NAME", help="matching method (default %(default)s)")
    add("--benchmarks", type=Path, metavar="FILE", help="page of results; its section 'as-built' is written")
    return parser


def main() -> int:
    """The command line."""
    options = _parser().parse_args()
    specs = select_sequences(DEMO if options.list is None else read_specs(options.list), options.sequences)
    config = Config(matching=MatchingSettings(method=options.method))
    text = table(measure(specs, options.seeds, (options.moved, options.gone), options.out, config))
    write_atomically(options.out / "as_built.md", f"# As built against as planned\n\n{text}")
    if options.benchmarks is not None:
        command = f"python -m evaluation.studies.as_built --out {options.out.name} --method {options.method}"
        command += f" --benchmarks {options.benchmarks.name}"
        section = f"## As built against as planned\n\n{_ABOUT}\n\n{text}\nBy {made_by(command)}."
        write_section(options.benchmarks, "as-built", section)
    print(text)
    return 0


_ABOUT = (
    f"Walls are counted by IFC wall. To find: walls of which {LEAST_VIEWS} keyframes or more could see half a metre "
    "(through the place of an absent wall). Moved walls are built 10 to 30 cm off the plan; extra walls are missing in "
    "the plan. Precision is over all significant reports, for extra walls over wall surfaces. Kinds: "
    f"{', '.join(KINDS)}; in each drive all three may be reported falsely. The run gets the storey, but no initial "
    "pose."
)


if __name__ == "__main__":
    run_command(main)
