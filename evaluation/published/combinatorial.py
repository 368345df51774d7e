"""Our implementation of iS-Graphs' search against measurements of its public code."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import Any

import pandas as pd
from pydantic import Field

from evaluation.harness import Case, Cost, Options, Record, Study
from evaluation.harness.tables import grouped
from evaluation.published.combinatorial_questions import (
    GIVEN_UP,
    HEAVY,
    VERSIONS,
    Question,
    Version,
    describe,
    layouts,
    questions,
)
from matching.combinatorial import DEVELOP, GRID, CombinatorialMatcher


class Choice(Options):
    """The time limit of an answer (s), and whether the layouts that may reach it are included."""

    limit_s: float = Field(60.0, gt=0)
    heavy: bool = True


class Search(Case):
    """A question or a layout, by its name, and the version of the public code whose search it is given to."""

    asked: str
    version: Version
    limit_s: float


class Answer(Record):
    """The answer in words, whether the time limit ended the search, and its CPU seconds."""

    answer: str
    stopped: bool
    seconds: Cost


def cases(options: Choice) -> list[Search]:
    """Every question and layout, for both versions."""
    names = [*questions(), *(name for name in layouts() if options.heavy or name not in HEAVY)]
    return [Search(asked=name, version=of, limit_s=options.limit_s) for name in names for of in VERSIONS]


def measure(case: Search, work: Path) -> Answer:
    """Searches the pairs of the question."""
    settings = DEVELOP if case.version == "released" else GRID
    match = CombinatorialMatcher(replace(settings, limit_s=case.limit_s)).match
    match(*layouts()["2:2"].pairs[0])  # a process's first search takes longer
    pairs = (questions().get(case.asked) or layouts()[case.asked]).pairs
    began = process_time()
    results = [match(s, a) for s, a in pairs]
    seconds = process_time() - began
    stopped = any(result.seconds >= case.limit_s for result in results)
    return Answer(answer=describe(pairs, results), stopped=stopped, seconds=seconds)


def tables(rows: pd.DataFrame) -> Mapping[str, Any]:
    """The answers, the seconds, and the largest ratio of our seconds to the public code's."""
    times = _with_public_code(rows, layouts())
    times["ratio"] = (times.seconds / times.public).where(~times.stopped)
    return {
        "answers": grouped(_with_public_code(rows, questions()), ("asked",), _answers),
        "times": grouped(times, ("asked",), _times).rename(columns={"asked": "layout"}),
        "largest_ratio": f"{times.ratio.max():.2f}",
    }


def _with_public_code(rows: pd.DataFrame, known: Mapping[str, Question[Any]]) -> pd.DataFrame:
    """The rows of the known questions, the last for each version, with what was measured on the public code."""
    own = rows[rows.asked.isin(known)].drop_duplicates(["asked", "version"], keep="last")
    public = [known[row.asked].public[VERSIONS.index(row.version)] for row in own.itertuples()]
    return own.assign(public=public)


def _answers(own: pd.DataFrame) -> dict[str, str]:
    return {
        f"{whose}, {row.version}": answer
        for row in own.itertuples() for whose, answer in (("public code", row.public), ("ours", row.answer))
    }  # fmt: skip


def _times(own: pd.DataFrame) -> dict[str, str]:
    """Where the public code was stopped, its time is a lower bound, and the ratio an upper one."""
    cells: dict[str, str] = {}
    for row in own.itertuples():
        late = row.public in GIVEN_UP
        cells |= {
            f"public code, {row.version} (s)": "" if pd.isna(row.public) else f"{'> ' if late else ''}{row.public:g}",
            f"ours, {row.version} (s)": f"stopped at {row.limit_s:g}" if row.stopped else f"{row.seconds:.2f}",
            f"ratio, {row.version}": "" if pd.isna(row.ratio) else f"{'< ' if late else ''}{row.ratio:.3f}",
        }
    return cells


STUDY = Study(
    "combinatorial", "whether our implementation of iS-Graphs' search answers as its public code, and how fast",
    Choice, Choice(heavy=False), Search, Answer, cases, measure, tables, small=True, timed=True,
)  # fmt: skip
