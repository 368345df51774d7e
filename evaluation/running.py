"""Runs a study: computes the rows that are missing or out of date, in processes or on a Dask cluster."""

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import monotonic

from data.common.build import content_hash
from data.common.errors import UserError
from data.common.processes import completed
from evaluation.rows import FAILED, Provenance, Row, appending, finish, read_rows, rows_path
from evaluation.study import Case, Options, Record, Study, load_study

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Place:
    """The folder of the rows, and that of drives and other intermediate files; how many processes are used, or the
    Dask scheduler whose workers are used instead."""

    rows: Path
    work: Path
    jobs: int = 1
    scheduler: str | None = None


def run_study(study: Study, options: Options, place: Place, command: str, whole: bool = True) -> list[Row]:
    """Computes the rows of a study and writes them to `place`; returns them, those that failed too.

    Rows of this build are kept, so that an interrupted run can be repeated; failed ones are computed again. Cases that
    read files which are not there are skipped. With `whole`, rows of cases that are no longer listed are dropped.
    Raises UserError as the study does, and as `data.common.processes` does.
    """
    path, part = rows_path(place.rows, study.name), rows_path(place.rows, f"{study.name}.part")
    wanted = _present(study, study.cases(options))
    before, by_key = {row.key: row for row in read_rows(path)}, {case.key: case for case in wanted}
    found = {
        row.key: row
        for row in (*before.values(), *read_rows(part))
        if row.key in by_key and row.made.build == content_hash(by_key[row.key].depends) and not row.failed
    }
    groups: dict[str, list[str]] = {}
    for case in wanted:
        if case.key not in found:
            groups.setdefault(case.group, []).append(case.key)
    todo = sum(map(len, groups.values()))
    print(f"{study.name}: {len(wanted)} cases, {todo} to compute", flush=True)
    began, done = monotonic(), 0
    place.work.mkdir(parents=True, exist_ok=True)
    measure = partial(measure_group, study.name, str(place.work.resolve()), os.getcwd())
    jobs = 1 if study.timed else place.jobs
    with appending(part) as append, _one_thread():
        for keys, answer in completed(measure, map(tuple, groups.values()), jobs, place.scheduler):
            if isinstance(answer, BaseException):  # the process ended, or the worker was lost
                answer = [_failure(answer)] * len(keys)
            for key, record in zip(keys, answer, strict=True):
                made = Provenance.of(command, by_key[key].depends)
                found[key] = Row(by_key[key].model_dump(mode="json"), record, made)
                append(found[key])
            done += len(keys)
            left = (monotonic() - began) / done * (todo - done) / 60
            print(f"{study.name}: {done}/{todo}; about {left:.0f} min left", flush=True)
    rows = [found[case.key] for case in wanted]
    there = {row.key for row in rows}
    finish(path, [*([] if whole else [row for row in before.values() if row.key not in there]), *rows])
    part.unlink()
    return rows


def measure_group(name: str, work: str, folder: str, keys: Sequence[str]) -> list[Record]:
    """The records of cases (JSON) of one group, in the working directory `folder`; an error becomes the record of its
    case."""
    if Path(folder).is_dir():
        os.chdir(folder)
    Path(work).mkdir(parents=True, exist_ok=True)
    study = load_study(name)
    cases = [study.case.model_validate_json(key) for key in keys]
    records = []
    for case in cases:
        try:
            records.append(study.measure(case, Path(work)))
        except Exception as error:
            records.append(_failure(error))
    study.release(cases[-1], Path(work))
    return records


def _failure(error: BaseException) -> Record:
    first = (str(error).strip() or "no message").splitlines()[0]
    reason = first if isinstance(error, UserError) else f"{type(error).__name__}: {first}"
    return {"status": FAILED, "reason": reason}


def _present(study: Study, cases: Sequence[Case]) -> list[Case]:
    """The cases whose files are there, each once; says on standard error which are skipped."""
    if not cases:
        raise UserError(f"{study.name}: no case; see --set")
    every = list({case.key: case for case in cases}.values())
    missing = {case.key: sorted(file for file in case.files() if not Path(file).exists()) for case in every}
    if lacking := sorted({file for files in missing.values() for file in files}):
        skipped = sum(map(bool, missing.values()))
        print(f"{study.name}: {skipped} cases are skipped, since they need {', '.join(lacking)}", file=sys.stderr)
    return [case for case in every if not missing[case.key]]


@contextmanager
def _one_thread() -> Iterator[None]:
    """The child processes get one thread each, where nothing else is set."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update({name: value or "1" for name, value in before.items()})
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None) if value is None else os.environ.update({name: value})
