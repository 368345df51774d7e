"""Our implementation of iS-Graphs' search against measurements of its public code."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import Any

import pandas as pd
from pydantic import Field

from evaluation.harness import Case, Claim, Cost, Options, Record, Study
from evaluation.harness.tables import grouped
from evaluation.published.combinatorial_questions import GIVEN_UP, HEAVY, Version, describe, layouts, questions
from matching.combinatorial import DEVELOP, GRID, CombinatorialMatcher

VERSIONS: dict[Version, str] = {"released": "released", "later": "later branch"}


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
    pairs = {**questions(), **layouts()}[case.asked].pairs
    began = process_time()
    results = [match(s, a) for s, a in pairs]
    seconds = process_time() - began
    stopped = any(result.seconds >= case.limit_s for result in results)
    return Answer(answer=describe(pairs, results), stopped=stopped, seconds=seconds)


def tables(rows: pd.DataFrame) -> Mapping[str, Any]:
    """The answers, the seconds, and the largest ratio of our seconds to the public code's."""
    answers, times = _with_public_code(rows)
    return {
        "answers": grouped(answers, ("asked",), _answers),
        "times": grouped(times, ("asked",), _times).rename(columns={"asked": "layout"}),
        "largest-ratio": f"{times.ratio.max():.2f}",
    }  # fmt: skip


def claims(rows: pd.DataFrame) -> list[Claim]:
    """How long our search takes, compared with the public code."""
    ratio = _with_public_code(rows)[1].ratio
    text = "Our implementation of iS-Graphs' search is faster than its public code: largest ratio of the seconds"
    return [Claim(text, f"{ratio.max():.2f}", f"{ratio.count()} searches")]


def _with_public_code(rows: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The rows of questions and those of layouts, the last for each version, with what was measured on the public
    code; those of layouts with the ratio of our seconds to its seconds, which is unknown if our search was stopped."""
    last = rows.drop_duplicates(["asked", "version"], keep="last")
    of_questions, of_layouts = questions(), layouts()
    answers, times = (last[last.asked.isin(of)].copy() for of in (of_questions, of_layouts))
    answers["public"] = [of_questions[row.asked].public(row.version) for row in answers.itertuples()]
    times["public"] = [of_layouts[row.asked].public(row.version) for row in times.itertuples()]
    times["ratio"] = (times.seconds / times.public).where(~times.stopped)
    return answers, times


def _answers(own: pd.DataFrame) -> dict[str, str]:
    cells = {}
    for row in own.itertuples():
        of = VERSIONS[row.version]
        cells |= {f"public code, {of}": row.public, f"ours, {of}": row.answer}
    return cells


def _times(own: pd.DataFrame) -> dict[str, str]:
    """Where the public code was stopped, its time is a lower bound, and the ratio an upper one."""
    cells = {}
    for row in own.itertuples():
        of, late = VERSIONS[row.version], row.public in GIVEN_UP
        cells |= {
            f"public code, {of} (s)": "" if pd.isna(row.public) else f"{'> ' if late else ''}{row.public:g}",
            f"ours, {of} (s)": f"stopped at {row.limit_s:g}" if row.stopped else f"{row.seconds:.2f}",
            f"ratio, {of}": "" if pd.isna(row.ratio) else f"{'< ' if late else ''}{row.ratio:.3f}",
        }
    return cells


STUDY = Study(
    "combinatorial", "whether our implementation of iS-Graphs' search answers as its public code, and how fast",
    Choice, Choice(heavy=False), Search, Answer, cases, measure, tables, claims, small=True, timed=True,
)  # fmt: skip
