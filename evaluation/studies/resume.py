"""Runs that are killed (SIGKILL) at a random time and resumed, compared with an uninterrupted run."""

import json
import signal
import subprocess
import sys
from collections.abc import Mapping
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from time import sleep

import numpy as np
import pandas as pd

from data.common.errors import UserError
from data.trajectory import Trajectory
from evaluation.drives.sequences import SequenceSpec, prepare
from evaluation.harness import Case, Cost, Options, Record, Study
from sgslam.session.checkpoints import FILE, about_run

DEMO = SequenceSpec(name="demo", bim="demo", min_rooms=6, min_length=50.0)
COMPARED = ("matches.json", "deviations.json", "s_graph.json", "pose_graph.g2o")
_LATEST = 0.9  # share of the run's time; later, the run may finish before it is killed


class Choice(Options):
    """A folder of scans and its building, the demo's drive by default; the number of kills, and the seed of the drive
    and of the times of the kills."""

    scans: str | None = None
    bim: str | None = None
    kills: int = 5
    seed: int = 0


class Kill(Case):
    """One killed run; the drive is the demo's if no scans are given."""

    scans: str | None
    bim: str | None
    seed: int
    kill: int

    def files(self) -> set[str]:
        """The scans and the building."""
        return {path for path in (self.scans, self.bim) if path is not None}


class Difference(Record):
    """A run killed `after_s` seconds after its first checkpoint and resumed from a state of `keyframes` keyframes.

    `metres` and `degrees` are the largest differences of its poses, None if it has poses of other scans; `same` are the
    compared files with the same content.
    """

    after_s: Cost
    keyframes: Cost
    metres: float | None
    degrees: float | None
    same: tuple[str, ...]


def cases(options: Choice) -> list[Kill]:
    """The kills."""
    same = {"scans": options.scans, "bim": options.bim, "seed": options.seed}
    return [Kill(**same, kill=kill) for kill in range(options.kills)]


def measure(case: Kill, work: Path) -> Difference:
    """Runs to the end; runs, kills and resumes. Raises UserError if a run fails."""
    arguments, rng = _arguments(case, work), np.random.default_rng([case.seed, case.kill])
    with TemporaryDirectory(dir=work) as folder:
        whole = Path(folder) / "whole"
        _run([*arguments, "--out", str(whole)])
        took = float(json.loads((whole / "metrics.json").read_text())["seconds"]["total"])
        for attempt in count():  # a run that has finished before it was killed does not count
            killed, after_s = Path(folder) / f"killed-{attempt}", float(rng.uniform(0.0, _LATEST * took))
            if _killed([*arguments, "--out", str(killed)], killed / FILE, after_s):
                break
        keyframes = float(about_run(killed)["keyframes"])
        _run(["--resume", str(killed)])
        return compared(whole, killed, after_s, keyframes)


def _arguments(case: Kill, work: Path) -> list[str]:
    """The arguments of the run, without its folder."""
    if case.scans is not None:
        return ["--scan-dir", case.scans, *([] if case.bim is None else ["--bim", case.bim])]
    drive = prepare(DEMO, case.seed, work)
    return ["--scan-dir", str(drive.scan_dir), "--bim", str(drive.bim)]


def _killed(arguments: list[str], checkpoint: Path, after_s: float) -> bool:
    """Kills a run `after_s` seconds after its first checkpoint; False if it had finished before."""
    process = subprocess.Popen(_command(arguments), stdout=subprocess.DEVNULL)
    while not checkpoint.is_file() and process.poll() is None:
        sleep(0.02)
    sleep(after_s)
    process.send_signal(signal.SIGKILL)
    if (code := process.wait()) > 0:
        raise UserError(f"a run failed with {code}; see its message above")
    return code == -signal.SIGKILL


def _command(arguments: list[str]) -> list[str]:
    return [sys.executable, "-m", "sgslam.run", *arguments]


def _run(arguments: list[str]) -> None:
    done = subprocess.run(_command(arguments), capture_output=True, text=True, check=False)
    if done.returncode:
        raise UserError(f"a run failed: {(done.stderr.strip() or 'no message').splitlines()[-1]}")


def compared(whole: Path, resumed: Path, after_s: float, keyframes: float) -> Difference:
    """The differences between the folders of two runs."""
    a, b = (Trajectory.read_tum(folder / "trajectory.tum") for folder in (whole, resumed))
    same = tuple(name for name in COMPARED if _content(whole / name) == _content(resumed / name))
    metres = degrees = None
    if np.array_equal(a.stamps_ns, b.stamps_ns):
        metres = float(np.abs(a.positions - b.positions).max())
        chord = np.linalg.norm(a.poses[:, :3, :3] - b.poses[:, :3, :3], axis=(1, 2)).max() / np.sqrt(8)
        degrees = 2 * float(np.degrees(np.arcsin(min(float(chord), 1.0))))
    return Difference(after_s=after_s, keyframes=keyframes, metres=metres, degrees=degrees, same=same)


def _content(path: Path) -> object:
    """The content of a file, without the matcher's time."""
    text = path.read_text()
    return json.loads(text) | {"seconds": None} if path.name == "matches.json" else text


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """A line for each killed run."""
    cells = pd.DataFrame({
        "killed after": rows.after_s.map("{:.1f} s".format), "keyframes in the state": rows.keyframes.astype(int),
        "largest difference of poses": [_difference(m, d) for m, d in zip(rows.metres, rows.degrees, strict=True)],
        "identical files": rows.same.str.join(", "),
    })  # fmt: skip
    return {"kills": cells}


def _difference(metres: float, degrees: float) -> str:
    if pd.isna(metres):
        return "poses of other scans"
    return "nothing" if metres == degrees == 0 else f"{metres:.1e} m, {degrees:.1e} deg"


STUDY = Study(
    "resume", "whether a run that is killed and resumed gives what an uninterrupted one gives",
    Choice, Choice(kills=2), Kill, Difference, cases, measure, tables,
)  # fmt: skip
