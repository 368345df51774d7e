"""The tasks of the matching benchmark: all pairs and methods without a row."""

from collections.abc import Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from data.common.errors import UserError
from evaluation.matching_benchmark.cells import SIZES, size_of
from evaluation.matching_benchmark.methods import load_method
from evaluation.matching_benchmark.pairs import DRAWN, NEGATIVE, Pair, pairs_of_cell, read_candidates, slam_pairs
from evaluation.matching_benchmark.rows import ORACLE
from evaluation.matching_benchmark.worker import Task


@dataclass(frozen=True)
class BenchmarkOptions:
    """The checked options of the command; `pairs` is the number of pairs per cell by method."""

    out: Path
    plans: tuple[Path, ...]
    generated: tuple[str, ...]
    slam_graphs: Path | None
    pairs: dict[str, int]
    regimes: tuple[str, ...]
    rooms: tuple[int | None, ...]
    sizes: tuple[str, ...]
    seed: int
    limit_s: float
    jobs: int
    scheduler: str | None

    @staticmethod
    def of(options: Any) -> "BenchmarkOptions":
        """Checks the options. Raises UserError for invalid ones."""
        regimes = DRAWN if options.regimes is None else tuple(options.regimes)
        if unknown := set(regimes) - set(DRAWN):
            raise UserError(f"--regimes {' '.join(sorted(unknown))}: there are {', '.join(DRAWN)}")
        if unknown := set(options.sizes) - set(SIZES):
            raise UserError(f"--sizes {' '.join(sorted(unknown))}: there are {', '.join(SIZES)}")
        for name, value in (("pairs", options.pairs), ("limit", options.limit), ("jobs", options.jobs)):
            if not value > 0:
                raise UserError(f"--{name} {value:g}: must be more than 0")
        pairs = dict.fromkeys(options.methods, options.pairs)
        for text in options.pairs_of:
            method, _, count = text.partition(":")
            if method not in pairs or not count.isdecimal() or int(count) == 0:
                raise UserError(f"--pairs-of {text}: write METHOD:N with one of the methods {', '.join(pairs)}")
            pairs[method] = int(count)
        for method in pairs:
            if method != ORACLE:
                load_method(method)  # raises for a name that does not exist
        return BenchmarkOptions(
            options.out, tuple(options.plans), tuple(options.generated), options.slam_graphs, pairs, regimes,
            tuple(map(_rooms, options.rooms)), tuple(options.sizes), options.seed, options.limit, options.jobs,
            options.scheduler,
        )  # fmt: skip


def _rooms(text: str) -> int | None:
    if text == "all":
        return None
    if not text.isdecimal() or int(text) == 0:
        raise UserError(f"--rooms {text}: give numbers of rooms, or 'all'")
    return int(text)


def tasks_of(wanted: BenchmarkOptions, there: Set[tuple[Any, ...]]) -> list[Task]:
    """All pairs with the methods that have no row in `there`, cell by cell."""
    tasks = []
    for cell in _cells(wanted):
        for n, pair in enumerate(cell):
            missing = tuple(
                method
                for method, most in wanted.pairs.items()
                if n < most and key_of(pair, method) not in there and (method, pair.regime) != (ORACLE, NEGATIVE)
            )
            if missing:
                tasks.append(Task(pair, missing))
    return tasks


def _cells(wanted: BenchmarkOptions) -> list[Sequence[Pair]]:
    cells: list[Sequence[Pair]] = []
    most = max(wanted.pairs.values())
    if wanted.plans or wanted.generated or wanted.slam_graphs is None:
        candidates = read_candidates(wanted.plans, wanted.generated)
        for size in wanted.sizes:
            own = [c for c in candidates if size_of(c.size) == size]
            for regime in wanted.regimes:
                # the published perturbation drops rooms by itself
                counts = (None,) if regime == "paper" else wanted.rooms
                cells += [pairs_of_cell(own, regime, rooms, most, wanted.seed) for rooms in counts]
    if wanted.slam_graphs is not None:
        cells.append(slam_pairs(wanted.slam_graphs))
    return cells


def key_of(pair: Pair, method: str) -> tuple[Any, ...]:
    """The key of the row that the method will have on the pair."""
    source, target = pair.source_name, pair.target
    return method, pair.regime, target.plans, target.plan.name, source, pair.rooms, pair.index, pair.seed
