"""Runs a study: computes what its rows lack, so that an interrupted run can be repeated."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Any

from data.common.build import content_hash
from data.common.errors import UserError
from evaluation.harness.comparison import Comparison, compare
from evaluation.harness.execution import records_of
from evaluation.harness.provenance import Provenance
from evaluation.harness.row_file import Row, appending, finish, read_rows, rows_path
from evaluation.harness.study import Case, Options, Study

_PAGES = Path(__file__).resolve().parents[2] / "docs/benchmarks"
ROWS = _PAGES / "rows" if _PAGES.is_dir() else Path("out/evaluation/rows")  # beside the pages in a checkout
QUICK = "quick"  # folder of the rows of the short versions
_PROGRESS_EVERY_S = 5.0


@dataclass(frozen=True)
class Place:
    """Where a run reads and writes: the folder of the rows, and that of drives and other intermediate files; how many
    processes it uses, or the Dask scheduler whose workers are used instead."""

    rows: Path
    work: Path
    jobs: int = 1
    scheduler: str | None = None


def run_study(study: Study, options: Options, whole: bool, place: Place, command: str) -> Comparison:
    """Computes the rows of a study and writes them to `place`; returns how they compare with the rows before.

    Rows of this build that an interrupted run left are kept. Cases that read files which are not there are skipped.
    With `whole`, rows of cases that are no longer listed are dropped. Raises UserError as the study does.
    """
    path, part = rows_path(place.rows, study.name), rows_path(place.rows, f"{study.name}.part")
    wanted = _present(study, study.cases(options))
    before = {row.key: row for row in read_rows(path)}
    found = {row.key: row for row in (*before.values(), *read_rows(part)) if row.made.build == content_hash()}
    todo = [case for case in wanted if case.key not in found]
    print(f"{study.name}: {len(wanted)} cases, {len(todo)} to compute", flush=True)
    made, began = Provenance.of(command), monotonic()
    with appending(part) as append:
        shown = began
        answers = records_of(study, todo, place.work, place.jobs, place.scheduler)
        for done, (case, record) in enumerate(answers, 1):
            row = Row(case.model_dump(mode="json"), record, made)
            append(row)
            found[row.key] = row
            if monotonic() - shown > _PROGRESS_EVERY_S or done == len(todo):
                shown = monotonic()
                left = (shown - began) / done * (len(todo) - done) / 60
                print(f"{done}/{len(todo)} {_short(record)}; about {left:.0f} min left", flush=True)
    own = [found[case.key] for case in wanted]
    keys = {row.key for row in own}
    others = [] if whole else [row for row in before.values() if row.key not in keys]
    if own:
        finish(path, [*others, *own])
    part.unlink()
    return compare(study, [before[row.key] for row in own if row.key in before], own)


def _present(study: Study, cases: Sequence[Case]) -> list[Case]:
    """The cases whose files are there; says on standard error which are skipped."""
    missing = {case.key: [file for file in sorted(case.files()) if not Path(file).exists()] for case in cases}
    if lacking := [files for files in missing.values() if files]:
        absent = ", ".join(sorted({file for files in lacking for file in files}))
        print(f"{study.name}: {len(lacking)} cases are skipped, since they need {absent}", file=sys.stderr)
    if not cases:
        raise UserError(f"{study.name}: no case; see --set")
    return [case for case in cases if not missing[case.key]]


def _short(record: dict[str, Any]) -> str:
    """The first values of a record."""
    plain = [(name, value) for name, value in record.items() if isinstance(value, int | float | str)][:4]
    return ", ".join(f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}" for name, value in plain)
