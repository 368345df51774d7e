"""Matchers on plans and S-graphs with known truth: methods x regimes x plans x rooms seen.

The S-graph of a pair is drawn from a plan by a regime: one of `data.synthetic_maps.noise_models`, or `negative`:
`real`, from another building, so that every `unique` answer is wrong. Plans by which settings were chosen
(`validation`) are kept apart from the others (`test`); S-graphs that the SLAM system built are with the latter. Of
sets of plans that a network of the methods was trained on (its model card names them), only buildings that training
leaves aside are used.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Literal

from pydantic import PositiveFloat, PositiveInt

from data.plans import splits
from evaluation.harness import Options, Study
from evaluation.matching_benchmark.judge import judged
from evaluation.matching_benchmark.methods import ORACLE, load_method, trained_on
from evaluation.matching_benchmark.pairs import (
    NEGATIVE,
    REGIMES,
    DrawnPair,
    Pair,
    Regime,
    pairs_of_cell,
    prepared,
    slam_pairs,
)
from evaluation.matching_benchmark.plan_sets import Candidate, name_of_set, read_candidates, size_class, split_of
from evaluation.matching_benchmark.plots import plots
from evaluation.matching_benchmark.records import BenchmarkCase, MatchRecord
from evaluation.matching_benchmark.tables import claims, tables

DATA = Path("../shared/data")


class Choice(Options):
    """Which plans, maps and methods: `pairs` of each regime, number of rooms seen, size of plan, and of validation and
    test plans; `pairs_of` is their number for single methods, which must not exceed `pairs`.

    `plans` are files or folders in any known format; `generated` are KIND:COUNT, or KIND:COUNT:SKIPPED. `slam_graphs`
    is a folder that `evaluation.drives.slam_graphs` wrote. `limit_s` is the time limit of a match.
    """

    plans: tuple[Path, ...] = (
        *(DATA / "floorplans" / name for name in ("swiss_floors", "lifull.tar.gz", "msd")),
        *(DATA / "ifc" / f"{name}.ifc" for name in (
            "AC11-Institute-Var-2-IFC", "Office_A_20110811", "Jesse.1", "AC90R1-niedriha-V2-2x3", "AC20-FZK-Haus",
            "SampleHouse4",
        )),
    )  # fmt: skip
    generated: tuple[str, ...] = ("office:8", "corridor:4", "office:20:2000", "corridor:8:2000")
    slam_graphs: Path | None = Path("out/slam_graphs")
    methods: tuple[str, ...] = ("learned", "voting", ORACLE, "pca-gm", "superglue")
    regimes: tuple[Regime, ...] = REGIMES
    rooms: tuple[PositiveInt | Literal["all"], ...] = (2, 3, 4, 6, 9, 14, "all")
    sizes: tuple[Literal["small", "large"], ...] = ("small", "large")
    pairs: PositiveInt = 100
    pairs_of: Mapping[str, PositiveInt] = {"pca-gm": 25, "superglue": 25}
    seed: int = 0
    limit_s: PositiveFloat = 60.0


def cases(options: Choice) -> list[BenchmarkCase]:
    """Cell by cell; the methods of a pair are neighbours, so that a process prepares it once.

    Raises UserError as `load_method`, `read_candidates` and `slam_pairs` do.
    """
    for method in options.methods:
        load_method(method)
    return [
        BenchmarkCase(pair=pair, method=method, limit_s=options.limit_s)
        for cell in _cells(options)
        for n, pair in enumerate(cell)
        for method in options.methods
        if n < options.pairs_of.get(method, options.pairs) and (method, pair.regime) != (ORACLE, NEGATIVE)
    ]


def _cells(options: Choice) -> Iterator[Sequence[Pair]]:
    there = [path for path in options.plans if path.exists()]
    for path in set(options.plans) - set(there):
        # nothing is known of its plans; the harness says that they are skipped
        yield [DrawnPair(plans=str(path), plan="", regime=REGIMES[0], rooms=None, index=0, seed=options.seed)]
    pools: dict[tuple[str, str], list[Candidate]] = {}
    trained = {name_of_set(file) for method in options.methods for file in trained_on(method)}
    for candidate in read_candidates(there, options.generated):
        if name_of_set(candidate.plans) in trained and splits.split_of(candidate.plan.building) != "test":
            continue  # a network of these methods was trained or chosen by this building
        split = split_of(candidate.plans, candidate.plan.name)
        pools.setdefault((split, size_class(len(candidate.plan.graph.rooms))), []).append(candidate)
    for (_, size), own in pools.items():
        for regime in options.regimes if size in options.sizes else ():
            # the published perturbation drops rooms by itself
            for rooms in ("all",) if regime == "paper" else options.rooms:
                yield pairs_of_cell(own, regime, None if rooms == "all" else rooms, options.pairs, options.seed)
    if options.slam_graphs is not None:
        yield slam_pairs(options.slam_graphs)


def measure(case: BenchmarkCase, work: Path) -> MatchRecord:
    """Asks the method, and scores its answer."""
    return judged(prepared(case.pair), case.method, case.limit_s)


STUDY = Study(
    name="matching",
    asks="how well matchers find maps with known truth in plans",
    options=Choice,
    quick=Choice(
        plans=(), generated=("apartment:3:2000", "office:3:2000", "corridor:2:2000"), slam_graphs=None,
        methods=("learned", "voting", ORACLE), rooms=(2, 6, "all"), pairs=6,
    ),
    case=BenchmarkCase,
    record=MatchRecord,
    cases=cases,
    measure=measure,
    tables=tables,
    claims=claims,
    plots=plots,
    small=True,
)  # fmt: skip
