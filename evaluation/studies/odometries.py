"""KISS-ICP, small_gicp and an external odometry, alone and in runs.

    python -m evaluation.studies.odometries --out DIR --list FILE

Alone: on the points that a run passes to it, without walls, floor or plan. The external odometry is a TUM file of
KISS-ICP on whole scans. The CSV has a line for each drive and odometry; lines that exist already are skipped.
"""

import argparse
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from time import process_time

import numpy as np

from data.common.cli import Parser, run_command
from data.common.files import write_atomically
from data.scans import ScanFolder
from data.trajectory import Trajectory
from evaluation.harness import RecordFile, Sequence, SequenceSpec, prepare, read_specs, select_sequences
from evaluation.harness.benchmark_page import made_by, write_section
from evaluation.harness.record_file import Record
from evaluation.drives.sequences import odometry_alone, odometry_of_run
from evaluation.metrics.consistency import nees
from evaluation.metrics.trajectories import ape, error_in_bim, rpe
from evaluation.studies.timing import seconds_of_kiss_icp
from sgslam.config import Config, OdometrySettings
from sgslam.odometry import METHODS
from sgslam.odometry.external import ExternalOdometry
from sgslam.session import Result
from sgslam.slam import SceneGraphSlam

ODOMETRIES = {"kiss": "KISS-ICP", "small_gicp": "small_gicp", "given": "a TUM file"}
RPE_M = 1.0
WRONG_M = 0.5  # RMSE above which an anchored run counts as anchored to a wrong place


@dataclass(frozen=True, kw_only=True)
class Row:
    """One drive with one odometry.

    `alone_*` are the odometry's relative error over a metre and its absolute error after SE(3) alignment (m). `cpu_*`
    are CPU seconds, reading the scans included; `cpu_kiss` are those of KISS-ICP's own pipeline on the same drive.
    """

    sequence: str
    seed: int
    odometry: str
    scans: int
    alone_rpe_m: float
    alone_ape_m: float
    anchored: bool
    rmse_bim_m: float | None
    max_bim_m: float | None
    nees_per_dof: float | None
    cpu_alone: float
    cpu_run: float
    cpu_kiss: float


def measure(specs: list[SequenceSpec], seeds: list[int], names: Iterable[str], out: Path) -> list[Record]:
    """Runs what `out`/odometries.csv lacks; returns all requested records.

    Raises UserError as the simulator and the readers do.
    """
    out.mkdir(parents=True, exist_ok=True)
    file, requested = RecordFile(out / "odometries.csv", Row), []
    for spec in specs:
        for seed in seeds:
            cpu_kiss: float | None = None
            for name in names:
                record = file.find(sequence=spec.name, seed=seed, odometry=name)
                if record is None:
                    sequence = prepare(spec, seed, out)
                    cpu_kiss = cpu_kiss or seconds_of_kiss_icp(sequence.scan_dir)["cpu"]
                    record = file.add(_row(sequence, name, cpu_kiss))
                    print(_short(record), flush=True)
                requested.append(record)
    return requested


def _row(sequence: Sequence, name: str, cpu_kiss: float) -> Row:
    config = Config(odometry=OdometrySettings(method=name)) if name in METHODS else Config()  # type: ignore[arg-type]
    used = process_time()
    alone = odometry_of_run(ScanFolder(sequence.scan_dir), config) if name in METHODS else _given(sequence)
    cpu_alone = process_time() - used
    used = process_time()
    result = _run(sequence, config, None if name in METHODS else ExternalOdometry(alone))
    cpu_run = process_time() - used
    error = error_in_bim(result.trajectory, sequence.truth).position if result.anchored else None
    known = result.pose_covariances
    return Row(
        sequence=sequence.name, seed=sequence.seed, odometry=name, scans=len(result.trajectory),
        alone_rpe_m=rpe(alone, sequence.truth, RPE_M).translation.rmse,
        alone_ape_m=ape(alone, sequence.truth, "se3").translation.rmse,
        anchored=result.anchored, rmse_bim_m=None if error is None else error.rmse,
        max_bim_m=None if error is None else error.max,
        nees_per_dof=None if known is None else nees(known.trajectory, sequence.truth, known.covariances),
        cpu_alone=cpu_alone, cpu_run=cpu_run, cpu_kiss=cpu_kiss,
    )  # fmt: skip


def _given(sequence: Sequence) -> Trajectory:
    """The external odometry of the drive, cached next to the scans."""
    kept = sequence.scan_dir.parent / f"{sequence.scan_dir.name}.given.tum"
    if not kept.exists():
        odometry_alone(ScanFolder(sequence.scan_dir)).write_tum(kept)
    return Trajectory.read_tum(kept)


def _run(sequence: Sequence, config: Config, given: ExternalOdometry | None) -> Result:
    slam = SceneGraphSlam(sequence.a_graph, config=config)
    for scan in ScanFolder(sequence.scan_dir):
        T_odom_sensor = None if given is None else given.at(scan.stamp_ns)
        slam.add_scan(scan.stamp_ns, scan.points, scan.point_times, T_odom_sensor)
    return slam.finish()


def table(records: list[Record]) -> str:
    """Markdown table: a line for each sequence and odometry, over its seeds."""
    head = ("sequence", "odometry", "drives", "alone: RPE over 1 m (m)", "alone: APE (m)", "anchored", "wrong",
            "RMSE in the BIM frame (m)", "largest error (m)", "NEES per dof", "alone, times KISS-ICP",
            "whole run, times KISS-ICP")  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    groups: dict[tuple[str, str], list[Record]] = {}
    for record in records:
        groups.setdefault((record["sequence"], record["odometry"]), []).append(record)
    for (sequence, name), own in groups.items():
        errors = _numbers(own, "rmse_bim_m")
        lines.append("| " + " | ".join([
            sequence, ODOMETRIES[name], str(len(own)), f"{np.mean(_numbers(own, 'alone_rpe_m')):.3f}",
            f"{np.mean(_numbers(own, 'alone_ape_m')):.3f}", f"{sum(r['anchored'] == 'True' for r in own)}",
            f"{sum(error > WRONG_M for error in errors)}", _each(errors, 4), _each(_numbers(own, "max_bim_m"), 3),
            _each(_numbers(own, "nees_per_dof"), 2),
            "" if name == "given" else f"{_ratio(own, 'cpu_alone'):.2f}", f"{_ratio(own, 'cpu_run'):.2f}",
        ]) + " |")  # fmt: skip
    return "\n".join(lines) + "\n"


def _numbers(records: list[Record], column: str) -> list[float]:
    return [float(r[column]) for r in records if r[column]]


def _each(numbers: list[float], places: int) -> str:
    return ", ".join(f"{number:.{places}f}" for number in numbers)


def _ratio(records: list[Record], column: str) -> float:
    return float(np.median([float(r[column]) / float(r["cpu_kiss"]) for r in records]))


def _short(r: Record) -> str:
    error = f"{float(r['rmse_bim_m']):.4f} m" if r["rmse_bim_m"] else "not anchored"
    return f"{r['sequence']} seed {r['seed']} {r['odometry']}: alone {float(r['alone_ape_m']):.3f} m, {error}"


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m evaluation.studies.odometries", description="Measure the odometries.")
    add = parser.add_argument
    add("--out", type=Path, required=True, metavar="DIR", help="folder for odometries.csv, odometries.md, drives")
    add("--list", type=Path, required=True, metavar="FILE", help="YAML list of sequences")
    add("--sequences", nargs="+", metavar="NAME", help="only these of the list")
    add("--seeds", nargs="+", type=int, default=[0, 1, 2], metavar="N", help="seeds of the drives (default 0 1 2)")
    add("--odometries", nargs="+", choices=ODOMETRIES, default=list(ODOMETRIES), metavar="NAME", help="only these")
    add("--benchmarks", type=Path, metavar="FILE", help="page of results; its section 'odometries' is written")
    return parser


def main() -> int:
    """The command line."""
    options = _parser().parse_args()
    specs = select_sequences(read_specs(options.list), options.sequences)
    text = table(measure(specs, options.seeds, options.odometries, options.out))
    write_atomically(options.out / "odometries.md", f"# Odometries\n\n{text}")
    print(text, end="")
    if options.benchmarks is not None:
        names = f" --sequences {' '.join(options.sequences)}" if options.sequences else ""
        command = f"python -m evaluation.studies.odometries --out {options.out.name} --list {options.list}{names}"
        command += f" --seeds {' '.join(map(str, options.seeds))}"
        section = f"## Odometries\n\n{_ABOUT}\n\n{text}\nBy {made_by(command)}."
        write_section(options.benchmarks, "odometries", section)
    return 0


_ABOUT = (
    "Alone: the odometry on the points that a run passes to it, without walls, floor or plan; its absolute error is "
    "after SE(3) alignment. The external odometry is a TUM file of KISS-ICP on whole scans (voxel 0.5 m). Anchored "
    "runs get no initial pose; their errors are in building coordinates without alignment, one per drive. CPU times "
    "are relative to KISS-ICP's own pipeline on the same drive (median over the drives)."
)

if __name__ == "__main__":
    run_command(main)
