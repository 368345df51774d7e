"""Compares runs that were killed and resumed with an uninterrupted run.

    python -m evaluation.studies.resume SCANS BIM --out DIR

The command runs once to its end. Then it is started, killed (SIGKILL) at a random time and resumed, `--kills` times.
The output files are compared.
"""

import json
import shutil
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from time import sleep

import numpy as np

from data.common.cli import Parser, run_command
from data.common.errors import UserError
from data.common.files import write_atomically
from data.trajectory import Trajectory
from evaluation.harness.benchmark_page import made_by, write_section
from sgslam.session.checkpoints import FILE, about_run

_LATEST = 0.9  # share of the run's time; later, the run may finish before it is killed


@dataclass(frozen=True)
class Kill:
    """A run killed `after_s` seconds after its first checkpoint and resumed from a state of `keyframes` keyframes.

    `metres` and `degrees` are the largest differences of its poses; `same` are the files with the same content.
    """

    after_s: float
    keyframes: int
    metres: float
    degrees: float
    same: tuple[str, ...]


COMPARED = ("matches.json", "deviations.json", "s_graph.json", "pose_graph.g2o")


def measure(scans: Path, bim: Path | None, out: Path, kills: int, seed: int) -> list[Kill]:
    """Runs, kills and resumes in folders of `out`. Raises UserError if a run fails."""
    out.mkdir(parents=True, exist_ok=True)
    arguments = ["--scan-dir", str(scans), *([] if bim is None else ["--bim", str(bim)])]
    whole = out / "whole"
    _run([*arguments, "--out", str(whole)])
    took = float(json.loads((whole / "metrics.json").read_text())["seconds"]["total"])
    rng, found = np.random.default_rng(seed), list[Kill]()
    while len(found) < kills:
        folder = out / f"killed-{len(found)}"
        shutil.rmtree(folder, ignore_errors=True)
        process = subprocess.Popen(_command([*arguments, "--out", str(folder)]), stdout=subprocess.DEVNULL)
        while not (folder / FILE).is_file() and process.poll() is None:
            sleep(0.02)
        after_s = float(rng.uniform(0.0, _LATEST * took))
        sleep(after_s)
        process.send_signal(signal.SIGKILL)
        if process.wait() != -signal.SIGKILL:
            continue  # it had finished already
        keyframes = int(about_run(folder)["keyframes"])
        _run(["--resume", str(folder)])
        found.append(_compared(whole, folder, after_s, keyframes))
        print(table(found[-1:]).splitlines()[-1], flush=True)
    return found


def _command(arguments: list[str]) -> list[str]:
    return [sys.executable, "-m", "sgslam.run", *arguments]


def _run(arguments: list[str]) -> None:
    done = subprocess.run(_command(arguments), capture_output=True, text=True, check=False)
    if done.returncode:
        raise UserError(f"a run failed: {(done.stderr.strip() or 'no message').splitlines()[-1]}")


def _compared(whole: Path, resumed: Path, after_s: float, keyframes: int) -> Kill:
    a, b = (Trajectory.read_tum(folder / "trajectory.tum") for folder in (whole, resumed))
    if not np.array_equal(a.stamps_ns, b.stamps_ns):
        return Kill(after_s, keyframes, np.inf, np.inf, ())
    chord = np.linalg.norm(a.poses[:, :3, :3] - b.poses[:, :3, :3], axis=(1, 2)).max() / np.sqrt(8)
    degrees = 2 * float(np.degrees(np.arcsin(min(float(chord), 1.0))))
    same = tuple(name for name in COMPARED if _content(whole / name) == _content(resumed / name))
    return Kill(after_s, keyframes, float(np.abs(a.positions - b.positions).max()), degrees, same)


def _content(path: Path) -> object:
    """The content of a file, without the matcher's time."""
    if path.suffix != ".json":
        return path.read_text()
    content = json.loads(path.read_text())
    if not isinstance(content, dict):
        return content
    return {name: value for name, value in content.items() if name != "seconds"}


def table(kills: list[Kill]) -> str:
    """Markdown table: a line for each killed run."""
    head = ("killed after", "keyframes in the state", "largest difference of poses", "identical files")
    lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    for k in kills:
        apart = "nothing" if k.metres == k.degrees == 0 else f"{k.metres:.1e} m, {k.degrees:.1e} deg"
        lines.append(f"| {k.after_s:.1f} s | {k.keyframes} | {apart} | {', '.join(k.same)} |")
    return "\n".join(lines) + "\n"


def main() -> int:
    """The command line; returns 1 if a resumed run differs from the uninterrupted one by a millimetre or more."""
    parser = Parser(
        prog="python -m evaluation.studies.resume", description="Compare resumed runs with an uninterrupted run."
    )
    parser.add_argument("scans", type=Path, metavar="SCANS", help="folder of scans")
    parser.add_argument("bim", type=Path, nargs="?", metavar="BIM", help="the building")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the runs and resume.md")
    parser.add_argument("--kills", type=int, default=5, metavar="N", help="number of killed runs (default %(default)s)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="seed of the times of the kills")
    parser.add_argument("--benchmarks", type=Path, metavar="FILE", help="page of results; its section is written")
    options = parser.parse_args()
    kills = measure(options.scans, options.bim, options.out, options.kills, options.seed)
    text = table(kills)
    write_atomically(options.out / "resume.md", f"# Killed and resumed\n\n{text}")
    if options.benchmarks is not None:
        command = f"python -m evaluation.studies.resume {options.scans} {options.bim or ''} --out {options.out.name}"
        about = "Runs killed (SIGKILL) at random times and continued with `--resume`, against an uninterrupted run."
        section = f"## Killed and resumed\n\n{about}\n\n{text}\nBy {made_by(command)}."
        write_section(options.benchmarks, "resume", section)
    print(text, end="")
    return 0 if all(k.metres < 1e-3 and "matches.json" in k.same for k in kills) else 1


if __name__ == "__main__":
    run_command(main)
