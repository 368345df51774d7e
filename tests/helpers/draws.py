"""A study for tests of the harness: each case draws numbers by its seed, and takes a moment."""

import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from evaluation.harness import Case, Claim, Cost, Options, Record, Study


class Choice(Options):
    """Seeds, and a pause (s) in each case; `file` is a file that the cases read; `failing` seeds fail."""

    seeds: tuple[int, ...] = tuple(range(30))
    pause: float = 0.1
    file: str | None = None
    shift: float = 0.0
    failing: tuple[int, ...] = ()


class Draw(Case):
    """A seed and a pause (s)."""

    seed: int
    pause: float
    file: str | None = None
    shift: float = 0.0
    fails: bool = False

    def files(self) -> set[str]:
        """The file, if there is one."""
        return set() if self.file is None else {self.file}


class Drawn(Record):
    """A draw, and the time that it took."""

    value: float
    even: bool
    seconds: Cost
    status: str = "drawn"
    reason: str = ""


def cases(options: Choice) -> list[Draw]:
    """A case for each seed."""
    fields = {"pause": options.pause, "file": options.file, "shift": options.shift}
    return [Draw(seed=seed, fails=seed in options.failing, **fields) for seed in options.seeds]  # type: ignore[arg-type]


def measure(case: Draw, work: Path) -> Drawn:
    """Draws."""
    began = time.perf_counter()
    time.sleep(case.pause)
    value = float(np.random.default_rng(case.seed).normal()) + case.shift
    told = {"status": "failed", "reason": "no luck"} if case.fails else {}
    return Drawn(value=value, even=case.seed % 2 == 0, seconds=time.perf_counter() - began, **told)


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame | str]:
    """The mean, as a table and as a text."""
    mean = f"{rows.value.mean():.3f}"
    return {"mean": pd.DataFrame({"draws": [len(rows)], "mean": [mean]}), "value": mean}


def claims(rows: pd.DataFrame) -> list[Claim]:
    """One claim."""
    return [Claim("mean of the draws", f"{rows.value.mean():.3f}", str(len(rows)))]


STUDY = Study(
    "draws", "what random numbers are drawn", Choice, Choice(seeds=(0, 1, 2), pause=0.0), Draw, Drawn, cases, measure,
    tables, claims, small=True,
)  # fmt: skip
