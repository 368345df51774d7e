"""The published matcher's tables, with the results of other methods on the nearest data that are public.

First the published perturbation, also with an unknown start, then maps built by SLAM.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from pydantic import NonNegativeInt, PositiveFloat, PositiveInt

from evaluation.harness import Options, Study
from evaluation.matching_benchmark.judge import judged
from evaluation.matching_benchmark.methods import load_method
from evaluation.matching_benchmark.pairs import (
    SGSLAM,
    DrawnPair,
    Pair,
    SlamPair,
    number_of,
    pairs_of_cell,
    prepared,
    slam_pairs,
)
from evaluation.matching_benchmark.plan_sets import read_candidates
from evaluation.matching_benchmark.records import MatchCase, MatchRecord
from evaluation.published.known_map import REACH, SE2, KnownPart, known_parts
from evaluation.published.pairs import GENERATED, PublishedPair, published_pairs
from evaluation.published.tables import STARTS, claims, plots, tables

METHODS = ("combinatorial", "paper@published", "paper@repository", "voting", "learned")
SLOW = ("combinatorial",)
REAL_ROOMS: tuple[int | None, ...] = (2, 4, 6, None)


class Choice(Options):
    """The plans, maps and methods.

    `msd` is a folder of apartments of Modified Swiss Dwellings: `pairs` of each kind. `generated` is the number of
    generated apartments, one pair each. `known_map` is a file as for the study of this name, `slam_graphs` a folder
    that `evaluation.drives.slam_graphs` wrote. `networks` are files of `matching.published.train`, by their names in
    the table of contributions. `slow_pairs` is the number of pairs of the combinatorial search in the first table.
    `limit_s` is the time limit of a match.
    """

    msd: str | None = "../shared/data/floorplans/msd"
    pairs: PositiveInt = 50
    generated: NonNegativeInt = 500
    known_map: str | None = SE2
    slam_graphs: str | None = "out/slam_graphs"
    methods: tuple[str, ...] = METHODS
    networks: Mapping[str, str] = {}
    slow_pairs: NonNegativeInt = 12
    seed: int = 0
    limit_s: PositiveFloat = 60.0


class PublishedCase(MatchCase):
    """A match of the published tables; `network` is the method's name in the table of contributions."""

    pair: PublishedPair | KnownPart | DrawnPair | SlamPair
    network: str | None = None


def cases(options: Choice) -> list[PublishedCase]:
    """All pairs with their methods. Raises UserError for an unknown method, and as the readers do."""
    for method in (*options.methods, *map(_method, options.networks.values())):
        load_method(method)
    return [
        PublishedCase(pair=pair, method=method, limit_s=options.limit_s, network=network)
        for cell in _cells(options)
        for n, pair in enumerate(cell)
        for method, network in _methods(options, n, pair)
    ]


def _method(file: str) -> str:
    return f"paper@{file}"


def _methods(options: Choice, n: int, pair: Pair) -> Iterator[tuple[str, str | None]]:
    """The methods of pair number `n` of a cell: the slow ones only for the tables, the networks for the first one."""
    first = isinstance(pair, PublishedPair) and not pair.start_m
    slow = n < options.slow_pairs if first else pair.regime in ("known_map", SGSLAM)
    yield from ((method, None) for method in options.methods if slow or method not in SLOW)
    if first:
        yield from ((_method(file), name) for name, file in options.networks.items())


def _cells(options: Choice) -> Iterator[Sequence[Pair]]:
    """The pairs; a set whose file is missing has one pair, which the harness skips."""
    if options.msd is not None:
        yield from _of_plans(options.msd, options.pairs, options.seed)
    if options.generated:
        yield published_pairs(GENERATED, options.generated, options.seed)
    if options.known_map is not None:
        parts = known_parts(options.known_map)
        yield from (parts, list(map(_anywhere, parts)))
    if options.slam_graphs is not None:
        yield slam_pairs(Path(options.slam_graphs))


def _of_plans(folder: str, count: int, seed: int) -> Iterator[Sequence[Pair]]:
    """The published perturbation, with all starts, and the regime `real` with all numbers of rooms."""
    if not Path(folder).exists():
        yield [PublishedPair(plans=folder, plan="", regime="paper", rooms=None, index=0, seed=seed, start_m=0.0)]
        return
    known_start = published_pairs(folder, count, seed)
    for start in STARTS:
        yield [pair.model_copy(update={"start_m": start}) for pair in known_start]
    candidates = read_candidates([Path(folder)], [])
    yield from (pairs_of_cell(candidates, "real", rooms, count, seed) for rooms in REAL_ROOMS)


def _anywhere(part: KnownPart) -> KnownPart:
    """The part, moved by a motion that depends only on it."""
    rng = np.random.default_rng(
        number_of("se2-anywhere", f"{part.plan}/{part.plan}", part.rooms, part.index, part.seed)
    )
    T = (rng.uniform(-np.pi, np.pi), *rng.uniform(-REACH, REACH, 2).tolist())
    return part.model_copy(update={"regime": "known_map_moved", "T_new_s": T})


def measure(case: PublishedCase, work: Path) -> MatchRecord:
    """Asks the method, and scores its answer."""
    return judged(prepared(case.pair), case.method, case.limit_s)


STUDY = Study(
    "published", "what the published matcher's tables become where the start is unknown, and with other methods",
    Choice, Choice(pairs=2, generated=10, slam_graphs=None, methods=METHODS[1:]), PublishedCase, MatchRecord,
    cases, measure, tables, claims, plots, small=True,
)  # fmt: skip
