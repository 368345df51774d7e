"""A study for tests of the harness: each case draws a number by its seed, and takes a moment."""

import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from evaluation.study import Case, Claim, Options, Record, Study


class Choice(Options):
    """Seeds, and a pause (s) in each case; `file` is a file that the cases read; `failing` seeds raise."""

    seeds: tuple[int, ...] = tuple(range(30))
    pause: float = 0.1
    file: str | None = None
    failing: tuple[int, ...] = ()


class Draw(Case):
    """A seed and a pause (s)."""

    seed: int
    pause: float
    file: str | None = None
    fails: bool = False

    @property
    def group(self) -> str:
        """Three draws share a process."""
        return str(self.seed // 3)

    def files(self) -> set[str]:
        """The file, if there is one."""
        return set() if self.file is None else {self.file}


def cases(options: Choice) -> list[Draw]:
    """A case for each seed."""
    return [Draw(seed=k, pause=options.pause, file=options.file, fails=k in options.failing) for k in options.seeds]


def measure(case: Draw, work: Path) -> Record:
    """Draws; leaves a file for its group."""
    time.sleep(case.pause)
    (work / f"group-{case.group}").touch()
    if case.fails:
        raise ValueError("no luck")
    return {"value": float(np.random.default_rng(case.seed).normal()), "building": f"b{case.seed % 6}"}


def release(case: Draw, work: Path) -> None:
    """Removes the file of the group."""
    (work / f"group-{case.group}").unlink()


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame | str]:
    """The mean, as a table and as a text."""
    mean = f"{rows.value.mean():.3f}"
    return {"mean": pd.DataFrame({"draws": [len(rows)], "mean": [mean]}), "value": mean}


STUDY = Study(
    "draws",
    "what random numbers are drawn",
    Choice,
    Choice(seeds=(0, 1, 2), pause=0.0),
    Draw,
    cases,
    measure,
    tables,
    lambda rows: [Claim("mean of the draws", f"{rows.value.mean():.3f}", str(len(rows)))],
    release=release,
)
