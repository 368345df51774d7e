"""How well the matchers find maps with known truth in plans."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any, Literal

import pandas as pd
from pydantic import NonNegativeInt, PositiveFloat, PositiveInt

from evaluation.drive import release
from evaluation.matching import methods, pairs, scores
from evaluation.matching.pairs import NEGATIVE, PERTURBED, PUBLISHED_MAP, REGIMES, SGSLAM, MatchCase, Regime
from evaluation.study import Claim, Options, Record, Study
from evaluation.tables import Column, Query, mean
from matching.matcher import DEFAULT

DATA = "../shared/data/"
FLOORPLANS = tuple(f"{DATA}floorplans/{name}" for name in ("swiss_floors", "lifull.tar.gz", "msd"))
NAMES = ("AC11-Institute-Var-2-IFC", "Office_A_20110811", "Jesse.1", "AC90R1-niedriha-V2-2x3", "AC20-FZK-Haus")
IFC = tuple(f"{DATA}ifc/{name}.ifc" for name in (*NAMES, "SampleHouse4"))
FIRST = (pairs.FIRST_SEED, pairs.FIRST_TEST_SEED)


class Choice(Options):
    """`pairs` of a map and its plan for each of `regimes`, number of `rooms` seen, role and set of plans: `plans` are
    files or folders, beside `generated` ones; iS-Graphs' search gets `slow_pairs` of them. The maps that the system
    builds in `seconds` through each of `buildings`, and that in the file `published_map`."""

    plans: tuple[str, ...] = (*FLOORPLANS, *IFC)
    generated: tuple[str, ...] = tuple(f"{k}_{s + n}" for k in ("office", "corridor") for s in FIRST for n in range(8))
    regimes: tuple[Regime, ...] = REGIMES
    rooms: tuple[PositiveInt | Literal["all"], ...] = (1, 2, 3, 4, 6, 9, 14, "all")
    pairs: PositiveInt = 50
    methods: tuple[str, ...] = methods.ALL
    buildings: tuple[str, ...] = (
        *("house-1", "house-2", "fzk-haus", "niedriha", "sample-house", "jesse"),
        *(f"generated/{kind}_{seed}" for kind in ("apartment", "office", "l_shape") for seed in (902_000, 902_001)),
    )
    seconds: PositiveFloat = 90.0
    published_map: str = f"{DATA}slam_graphs/SE2.json"
    slow_pairs: NonNegativeInt = 12


QUICK = Choice(
    plans=(FLOORPLANS[-1], *IFC),
    generated=tuple(f"{k}_{s + n}" for k in ("office", "corridor") for s in FIRST for n in range(3)),
    rooms=(2, 6, "all"),
    pairs=5,
    buildings=tuple(f"generated/{kind}_902000" for kind in ("apartment", "office", "corridor", "l_shape", "skewed")),
    seconds=45.0,
    slow_pairs=2,
)


def cases(options: Choice) -> list[MatchCase]:
    """All pairs with their methods. Raises UserError for an unknown method, and as the readers do."""
    for method in options.methods:
        methods.matcher_named(method)
    return [
        pair.model_copy(update={"method": method})
        for cell in _cells(options)
        for n, pair in enumerate(cell)
        for method in options.methods
        if methods.applies(method, pair.regime) and (method != methods.COMBINATORIAL or n < options.slow_pairs)
    ]


def _cells(options: Choice) -> Iterator[Sequence[MatchCase]]:
    """The pairs; a set whose file is missing has one, which is skipped."""
    yield [MatchCase(plans=SGSLAM, plan=name, regime=SGSLAM, seconds=options.seconds) for name in options.buildings]
    if options.published_map:
        yield [MatchCase(plans=options.published_map, plan="", regime=PUBLISHED_MAP)]
    there = [path for path in options.plans if Path(path).exists()]
    yield [MatchCase(plans=path, plan="", regime=REGIMES[0]) for path in options.plans if path not in there]
    pools: dict[tuple[str, ...], list[pairs.Candidate]] = {}
    for one in pairs.read_candidates(there, options.generated):
        pools.setdefault(one.pool, []).append(one)
    for pool, regime in product(pools.values(), options.regimes):
        for rooms in ("all",) if regime in pairs.WHOLE else options.rooms:
            seen = None if rooms == "all" else rooms
            yield pairs.pairs_of_cell(pool, regime, seen, options.pairs, seed=0)


def measure(case: MatchCase, work: Path) -> Record:
    """Matches the maps of the pair, and scores the answers."""
    known = pairs.known_maps(case.model_copy(update={"method": ""}), work)
    maps = [scores.answered(one, case.method, case.limit_s) for one in known]
    return {**pairs.described(case, methods.trained_on(case.method)), "status": "done", "maps": maps}


# As printed in "Learning-Based Hierarchical Scene Graph Matching for Robot Localization Leveraging Prior Maps": its MSD
# test set, and its real environment, which is not public.
PRINTED = (
    ("MSD, as printed", "iS-Graphs", "", "0.99", "0.92", "0.95", "7.66", "86"),
    ("MSD, as printed", "the paper's network", "", "0.85", "0.85", "0.85", "0.093", "100"),
    ("real environment, as printed", "iS-Graphs", "", "0.88", "0.53", "0.67", "0.191", "100"),
    ("real environment, as printed", "the paper's network", "", "0.80", "0.88", "0.84", "0.021", "100"),
)
LINES = {"regime": "regime", "method": "method"}


def tables(rows: pd.DataFrame) -> Mapping[str, Any]:
    """What the methods find on test plans, the default in more detail, and the published perturbation and map."""
    own = scores.matches_of(rows)
    paper = own.regime.isin(pairs.PUBLISHED)
    test, ours = own[~paper & (own.role == "test")], own[own.method == DEFAULT]
    known = ours[ours.regime.isin(("real", "drift"))].sort_values("rooms", kind="stable")
    published = Query(LINES, scores.NODES).table(own[paper])
    return {
        "methods": Query(LINES, scores.FOUND).table(test[test.method.ne("oracle") | test.regime.eq(SGSLAM)]),
        "measures": Query({"regime": "regime"}, scores.MEASURES).table(
            ours[ours.role.eq("test") & ours.regime.ne(NEGATIVE)]
        ),
        "rooms": Query({"rooms": "rooms seen"}, scores.FOUND).table(known[known.role == "test"]),
        "sets": Query({"role": "role", "set": "set"}, scores.FOUND).table(known),
        "published": pd.concat([pd.DataFrame(PRINTED, columns=["regime", "method", *scores.NODES]), published]),
    }


def claims(rows: pd.DataFrame) -> list[Claim]:
    """Wall F1 of the default matcher and its wrong answers on test plans, and F1 of two methods on MSD."""
    own = scores.matches_of(rows)
    f1, on_msd = mean("wall.f1"), "F1 on MSD with the published perturbation"
    lines: list[tuple[str, str, Sequence[str], Column]] = [
        ("Wall F1 on maps with the noise of real scans", DEFAULT, ["real"], f1),
        ("Wall F1 on maps that the system built in simulation", DEFAULT, [SGSLAM], f1),
        ("Unique answers that are wrong", DEFAULT, [*REGIMES[:5], SGSLAM], scores.wrong),
        ("Maps of another building that are placed", DEFAULT, [NEGATIVE], scores.placed),
        *((on_msd, method, [PERTURBED], mean("node.f1")) for method in (DEFAULT, methods.PAPER[-1])),
    ]
    test = own[own.role == "test"]
    of = [test[(test.method == method) & test.regime.isin(regimes)] for _, method, regimes, _ in lines]
    return [
        Claim(f"{text}, `{method}`", value(each), f"{len(each)} maps, {each.building.nunique()} buildings")
        for (text, method, _, value), each in zip(lines, of, strict=True)
        if len(each)
    ]


STUDY = Study(
    name="matching",
    asks="how well the matchers find maps with known truth in plans",
    options=Choice,
    quick=QUICK,
    case=MatchCase,
    cases=cases,
    measure=measure,
    tables=tables,
    claims=claims,
    release=lambda case, work: release(case.drive, work) if case.regime == SGSLAM else None,
)
