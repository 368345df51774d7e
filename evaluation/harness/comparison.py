"""Whether anything moved: the rows of a study against those of the same cases before."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from evaluation.harness.row_file import Row
from evaluation.harness.study import Study

SAME = 1e-6  # difference, relative to values above 1, up to which two numbers are taken to be equal
Value = float | str | None


@dataclass(frozen=True)
class Moved:
    """A field that has other values than before in so many cases; the means are None where it is not a number."""

    cases: int
    before: float | None
    after: float | None

    def __str__(self) -> str:
        means = "" if self.before is None or self.after is None else f", mean {self.before:.4g} -> {self.after:.4g}"
        return f"{self.cases} cases{means}"


@dataclass(frozen=True)
class Comparison:
    """`moved` of `common` cases have other values than before, in these `fields`. In `failed` cases (JSON) what was
    measured raised an error: their records have the status "failed"."""

    study: str
    cases: int
    common: int
    moved: int
    fields: dict[str, Moved]
    failed: tuple[str, ...] = ()

    def lines(self) -> list[str]:
        """One line for the study, and one for each field that moved and each case that failed."""
        head = f"{self.study}: {self.cases} cases; {self.moved} of the {self.common} with a row before have moved"
        moved = [f"    {name}: {moved}" for name, moved in self.fields.items()]
        return [head, *moved, *(f"    failed: {case}" for case in self.failed)]


def compare(study: Study, before: Sequence[Row], after: Sequence[Row]) -> Comparison:
    """Compares the records of the cases that both have, without the fields that differ from run to run."""
    costs = study.record.costs()
    old = {row.key: dict(_values(row.record, costs)) for row in before}
    both = [(old[row.key], dict(_values(row.record, costs))) for row in after if row.key in old]
    fields, moved = {}, set[int]()
    for name in dict.fromkeys(name for pair in both for own in pair for name in own):
        pairs = [(was.get(name), now.get(name)) for was, now in both]
        changed = [n for n, (was, now) in enumerate(pairs) if not _equal(was, now)]
        if changed:
            moved.update(changed)
            fields[name] = Moved(len(changed), *(_mean(own) for own in zip(*pairs, strict=True)))
    failed = tuple(f"{row.key}: {row.record.get('reason')}" for row in after if row.record.get("status") == "failed")
    return Comparison(study.name, len(after), len(both), len(moved), fields, failed)


def _values(record: dict[str, Any], left_out: set[str], prefix: str = "") -> Iterator[tuple[str, Value]]:
    """The values of a record by their names; those of its parts as well."""
    for name, item in record.items():
        if name in left_out:
            continue
        if isinstance(item, list):
            item = {str(n): part for n, part in enumerate(item)}
        if isinstance(item, dict):
            yield from _values(item, left_out, f"{prefix}{name}.")
        else:
            yield prefix + name, item


def _equal(a: Value, b: Value) -> bool:
    if isinstance(a, int | float) and isinstance(b, int | float):
        return abs(a - b) <= SAME * max(abs(a), abs(b), 1.0)
    return a == b


def _mean(values: Sequence[Value]) -> float | None:
    numbers = [value for value in values if isinstance(value, int | float)]
    return sum(numbers) / len(numbers) if numbers else None
