"""Effect of motion distortion and deskewing on fast drives.

    python -m evaluation.studies.moving_scans --out DIR

Each drive is simulated twice: with instantaneous scans, and with the sensor moving during each revolution. The
difference in error is due to the motion. The CSV has a line for each drive and variant; existing lines are skipped.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data.common.cli import Parser, run_command
from data.common.files import write_atomically
from data.generation.demo_building import DEMO_STOREY, write_demo_building
from data.plans import load_bim
from data.scans import ScanFolder
from data.simulation import Robot
from data.simulation.simulate import simulate
from data.trajectory import Trajectory
from evaluation.harness import RecordFile
from evaluation.harness.benchmark_page import made_by, write_section
from evaluation.harness.record_file import Record
from evaluation.metrics.trajectories import error_in_bim
from sgslam.slam import SceneGraphSlam

DRIVES = {
    "quick": Robot(speed=1.5, acceleration=1.0, yaw_rate=1.2, yaw_acceleration=1.5),
    "hasty": Robot(speed=2.0, acceleration=1.5, yaw_rate=1.8, yaw_acceleration=3.0),
}
VARIANTS = {"snapshots": "snapshots", "as they are": "moving, as they are", "deskewed": "moving, deskewed"}


@dataclass(frozen=True, kw_only=True)
class Row:
    """One drive and variant (`arm`): whether the run was anchored, and its errors in the BIM frame (m)."""

    drive: str
    seed: int
    arm: str
    scans: int
    anchored: bool
    rmse_bim_m: float | None
    max_bim_m: float | None


def measure(seeds: list[int], out: Path) -> list[Record]:
    """Runs what `out`/moving_scans.csv lacks; returns all requested records."""
    out.mkdir(parents=True, exist_ok=True)
    file, requested = RecordFile(out / "moving_scans.csv", Row), []
    bim = out / "demo.ifc"
    if not bim.exists():
        write_demo_building(bim)
    for drive in DRIVES:
        for seed in seeds:
            for variant in VARIANTS:
                record = file.find(drive=drive, seed=seed, arm=variant)
                if record is None:
                    record = file.add(_row(drive, seed, variant, bim, out))
                    print(" ".join(record.values()), flush=True)
                requested.append(record)
    return requested


def _row(drive: str, seed: int, variant: str, bim: Path, out: Path) -> Row:
    folder, rolling = out / f"{drive}-{seed}{'' if variant == 'snapshots' else '-moving'}", variant != "snapshots"
    if not folder.exists():
        simulate(
            bim, DEMO_STOREY, folder, seed=seed, min_rooms=6, min_length=50.0, robot=DRIVES[drive], scan_format="ply",
            rolling=rolling,
        )  # fmt: skip
    truth, slam = Trajectory.read_tum(folder / "truth.tum"), SceneGraphSlam(load_bim(bim))
    for scan in ScanFolder(folder / "scans"):
        slam.add_scan(scan.stamp_ns, scan.points, scan.point_times if variant == "deskewed" else None)
    result = slam.finish()
    error = error_in_bim(result.trajectory, truth).position if result.anchored else None
    return Row(
        drive=drive, seed=seed, arm=variant, scans=len(truth), anchored=result.anchored,
        rmse_bim_m=None if error is None else error.rmse, max_bim_m=None if error is None else error.max,
    )  # fmt: skip


def table(records: list[Record]) -> str:
    """Markdown table: a line for each kind of drive and variant, over its seeds."""
    lines = ["| drives | scans | anchored | RMSE (m) | largest error (m) |", "|---|---|---|---|---|"]
    groups: dict[tuple[str, str], list[Record]] = {}
    for record in records:
        groups.setdefault((record["drive"], record["arm"]), []).append(record)
    for (drive, variant), own in groups.items():
        errors = ", ".join(f"{float(r['rmse_bim_m']):.4f}" if r["rmse_bim_m"] else "none" for r in own)
        largest = [float(r["max_bim_m"]) for r in own if r["max_bim_m"]]
        anchored = f"{sum(r['anchored'] == 'True' for r in own)} of {len(own)}"
        lines.append(f"| {drive} | {VARIANTS[variant]} | {anchored} | {errors} | {np.max(largest, initial=0.0):.3f} |")
    return "\n".join(lines) + "\n"


def main() -> int:
    """The command line."""
    parser = Parser(
        prog="python -m evaluation.studies.moving_scans", description="Measure the effect of deskewing on fast drives."
    )
    add = parser.add_argument
    add("--out", type=Path, required=True, metavar="DIR", help="folder for the results and drives")
    add("--seeds", nargs="+", type=int, default=[0, 1, 2], metavar="N", help="seeds of the drives (default 0 1 2)")
    add("--benchmarks", type=Path, metavar="FILE", help="page of results; its section 'moving' is written")
    options = parser.parse_args()
    text = table(measure(options.seeds, options.out))
    write_atomically(options.out / "moving_scans.md", f"# Scans of a moving sensor\n\n{text}")
    print(text, end="")
    if options.benchmarks is not None:
        about = "Anchored runs through the demo building; errors in building coordinates without alignment. "
        about += "; ".join(f"{name}: {_robot_limits(robot)}" for name, robot in DRIVES.items()) + "; 10 scans a second."
        made = made_by(f"python -m evaluation.studies.moving_scans --out {options.out.name}")
        write_section(options.benchmarks, "moving", f"## Scans of a moving sensor\n\n{about}\n\n{text}\nBy {made}.")
    return 0


def _robot_limits(robot: Robot) -> str:
    most = f"{robot.speed:g} m/s and {robot.yaw_rate:g} rad/s"
    return f"{most}, {robot.acceleration:g} m/s2 and {robot.yaw_acceleration:g} rad/s2"


if __name__ == "__main__":
    run_command(main)
