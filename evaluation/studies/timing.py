"""`python -m evaluation.studies.timing --scan-dir DIR --bim FILE`: time of a run relative to KISS-ICP's own pipeline.

Both process the same folder alternately, each in a process of its own. Imports, loading compiled loops and the report
are excluded; the IFC file is cached. The result is a ratio of medians, since absolute times depend on the machine. On a
shared machine the ratio of CPU times (all threads) is more reliable than that of wall-clock times; the load is printed.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from data.common.cli import Parser, run_command
from data.common.errors import UserError

_KISS = """
import json, sys, time
from pathlib import Path
from kiss_icp.datasets import dataset_factory
from kiss_icp.pipeline import OdometryPipeline
began, used = time.perf_counter(), time.process_time()
pipeline = OdometryPipeline(dataset_factory(dataloader="generic", data_dir=Path(sys.argv[1])))
pipeline.run()
seconds = {"whole": time.perf_counter() - began, "cpu": time.process_time() - used}
Path(sys.argv[2]).write_text(json.dumps(seconds))
"""


def seconds_of_kiss_icp(scan_dir: Path) -> dict[str, float]:
    """Seconds of KISS-ICP's pipeline in its default configuration (reading, odometry, results): `whole` is wall-clock
    time, `cpu` CPU time of all threads."""
    with tempfile.TemporaryDirectory() as folder:
        answer = Path(folder) / "seconds"
        _run([sys.executable, "-c", _KISS, str(scan_dir.resolve()), str(answer)], folder)
        seconds: dict[str, float] = json.loads(answer.read_text())
        return seconds


def seconds_of_run(scan_dir: Path, bim: Path | None) -> dict[str, float]:
    """Seconds of `sgslam.run` by stage; `whole` is wall-clock time without the report, `cpu` CPU time of all
    threads."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "sgslam.run", "--scan-dir", str(scan_dir.resolve()), "--out", "out"]
        _run(command + ([] if bim is None else ["--bim", str(bim.resolve())]), folder)
        metrics = json.loads((Path(folder) / "out" / "metrics.json").read_text())
    seconds = metrics["seconds"]
    return {**seconds, "whole": seconds["total"] - seconds["report"], "cpu": metrics["cpu_seconds"]}


def _run(command: list[str], folder: str) -> None:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        what = "sgslam.run" if "sgslam.run" in command else "KISS-ICP's pipeline"
        output = [line for line in (done.stderr + done.stdout).splitlines() if line.strip()]
        raise UserError(f"{what} failed on this folder: {output[-1].strip() if output else 'no message'}")


def main() -> int:
    """The command line."""
    parser = Parser(
        prog="python -m evaluation.studies.timing", description="Time a run relative to KISS-ICP's own pipeline."
    )
    add = parser.add_argument
    add("--scan-dir", type=Path, required=True, metavar="DIR", help="folder of scans (.bin for KISS-ICP)")
    parser.add_argument("--bim", type=Path, metavar="FILE", help="the building")
    parser.add_argument("--repeat", type=int, default=3, metavar="N", help="repetitions (default 3)")
    options = parser.parse_args()
    if options.repeat < 1:
        raise UserError(f"--repeat {options.repeat}: must be at least 1")
    if not options.scan_dir.is_dir():
        raise UserError(f"--scan-dir {options.scan_dir}: no such folder")
    if options.bim is not None:
        seconds_of_run(options.scan_dir, options.bim)  # fills the cache of the IFC file
    kiss, ours = [], []
    for _ in range(options.repeat):
        kiss.append(seconds_of_kiss_icp(options.scan_dir))
        ours.append(seconds_of_run(options.scan_dir, options.bim))
        clock, cpu = (ours[-1][which] / kiss[-1][which] for which in ("whole", "cpu"))
        print(
            f"KISS-ICP {kiss[-1]['whole']:.2f} s, run {ours[-1]['whole']:.2f} s: {clock:.2f} times; "
            f"processors {cpu:.2f} times; load {os.getloadavg()[0]:.1f}",
            flush=True,
        )
    for stage in ours[0]:
        reference = statistics.median(run["cpu" if stage == "cpu" else "whole"] for run in kiss)
        print(f"{stage:14s} {statistics.median(run[stage] for run in ours) / reference:6.2f} times KISS-ICP's pipeline")
    return 0


if __name__ == "__main__":
    run_command(main)
