"""What the matching benchmark says of rows: counts by hand, intervals that cover, calibrated confidences."""

import dataclasses
from typing import Any

import numpy as np
import pandas as pd
import pytest

from data import SceneGraph, WallSurface
from data.common.errors import UserError
from evaluation.harness.tables import rare
from evaluation.matching_benchmark.judge import is_wrong, tallies
from evaluation.matching_benchmark.records import Tally
from evaluation.matching_benchmark.scores import bins_of, estimate, gain, micro_f1, scored
from evaluation.matching_benchmark.tables import claims, tables, to_be_sure
from evaluation.metrics.bootstrap import ratio, upper_bound
from evaluation.metrics.calibration import Bin, binned, calibration_error
from evaluation.metrics.true_matches import TrueMatches
from matching.result import MatchResult

WALLS = tuple(WallSurface(name, None, (0.0, 0.0), (1.0, 0.0), 1.0) for name in ("one", "two", "cupboard", "shelf"))
S = SceneGraph("map", (), WALLS)
TRUTH = TrueMatches({}, {"one": "a", "two": "b"}, (0.0, 0.0, 0.0), None, (0.0, 0.0))


def row(**changes: Any) -> dict[str, Any]:
    known: dict[str, Any] = {
        "method": "voting", "limit_s": 60.0, "pair.plans": "set", "pair.plan": "p", "pair.regime": "real",
        "pair.rooms": 2, "pair.index": 0, "pair.seed": 0, "pair.source": None, "building": "b", "size": 10,
        "s_rooms": 2, "s_walls": 8, "status": "unique", "reason": "", "wrong": False, "twin": False, "rival": None,
        "seconds": 0.1, "room_tally": tally(2, 2, 2), "wall_tally": tally(6, 8, 8),
    }  # fmt: skip
    return {**known, **changes}


def tally(*counts: int, bins: tuple[tuple[float, ...], ...] = ()) -> dict[str, Any]:
    names = ("right", "answered", "true", "spare", "left")
    return {**dict(zip(names, (*counts, 0, 0), strict=False)), "bins": bins}


def frame(*rows: dict[str, Any]) -> pd.DataFrame:
    """Different pairs with these values."""
    return pd.json_normalize([{**row, "pair.index": n} for n, row in enumerate(rows)])


def value(rows: pd.DataFrame, score: str) -> float | None:
    found = estimate(rows, score)
    return None if found is None else found.value


def test_the_tally_of_an_answer() -> None:
    result = MatchResult("unique", "", (), (("one", "a", 0.97), ("two", "c", 0.91), ("shelf", "a", 0.2)))
    rooms, walls = tallies(result, TRUTH, S)
    assert rooms == Tally()
    # the shelf is matched though it is in no plan, the cupboard is left alone
    assert (walls.right, walls.answered, walls.true, walls.spare, walls.left) == (1, 3, 2, 2, 1)
    assert [b[:3] for b in walls.bins] == [(4, 1, 0), (18, 1, 0), (19, 1, 1)]


def test_every_unique_answer_is_wrong_where_nothing_of_the_map_is_in_the_plan() -> None:
    nothing = dataclasses.replace(TRUTH, wall_surfaces={})
    assert is_wrong(MatchResult("unique", "", T_a_s=(0.0, 0.0, 0.0)), nothing, bent=False)
    assert not is_wrong(MatchResult("ambiguous", "", T_a_s=(0.0, 0.0, 0.0)), nothing, bent=False)


def test_the_measures_of_three_pairs_by_hand() -> None:
    lost = {"wall_tally": tally(0, 0, 2), "room_tally": tally(0, 0, 2), "status": "late", "seconds": 60.0}
    rows = scored(frame(
        row(wall_tally=tally(8, 8, 8, 2, 2), building="x"),
        row(wall_tally=tally(3, 6, 6, 2, 0), building="x", status="ambiguous", twin=True),
        row(building="y", **lost),
    ))  # fmt: skip
    assert value(rows, "wall_precision") == pytest.approx((1 + 0.5) / 2)  # of two answers
    assert value(rows, "wall_recall") == pytest.approx((1 + 0.5 + 0) / 3)
    assert value(rows, "wall_f1") == pytest.approx((1 + 0.5 + 0) / 3)
    assert micro_f1(rows, "wall") == pytest.approx(2 * 11 / (14 + 16))
    assert value(rows, "wall_accuracy") == pytest.approx((1 + 3 / 8 + 0) / 3)
    shares = [value(rows, name) for name in ("unique", "ambiguous", "none", "decided", "perfect")]
    assert shares == pytest.approx([1 / 3, 1 / 3, 0, 1 / 2, 1 / 3])


@pytest.mark.parametrize("status", ["failed", "late"])
def test_an_answer_that_was_not_given_is_right_nowhere(status: str) -> None:
    """A map of another building: to leave all its walls alone is right, to give no answer is not."""
    nothing = {"room_tally": tally(0, 0, 0), "wall_tally": tally(0, 0, 0, 4, 4)}
    rows = scored(frame(row(**nothing, status="none"), row(**nothing, status=status)))
    assert rows.filled_f1.tolist() == rows.wall_accuracy.tolist() == [1.0, 0.0]
    shares = [value(rows, name) for name in ("unique", "ambiguous", "none", "unanswered", "decided")]
    assert shares == [0, 0, 0.5, 0.5, 0]


def test_what_there_is_nothing_of_is_not_measured() -> None:
    unlike = {"room_tally": tally(0, 1, 0), "wall_tally": tally(0, 3, 0, 4, 1), "twin": None, "wrong": True}
    rows = scored(frame(row(**{"pair.regime": "negative"}, **unlike)))
    assert all(value(rows, name) is None for name in ("wall_f1", "wall_recall", "perfect", "decided"))
    assert value(rows, "wall_accuracy") == 0.25
    assert rare(1, 1) == "1 of 1 (≤ 100.0 %)" and rare(0, 0) == "0 of 0"


def test_confidences_are_summed_bin_by_bin() -> None:
    halves = [tally(1, 2, 2, bins=((3, 1, 0, 0.15), (19, 1, 1, 1.0))), tally(1, 1, 1, bins=((19, 2, 1, 1.9),))]
    rows = scored(frame(*(row(wall_tally=half) for half in halves)))
    assert bins_of(rows, "wall") == (Bin(3, 1, 0, 0.15), Bin(19, 3, 2, 2.9))


def test_gains_are_those_of_common_pairs() -> None:
    def pair(index: int, **right: int) -> list[dict[str, Any]]:
        return [row(method=m, **{"pair.index": index}, wall_tally=tally(n, 4, 4)) for m, n in right.items()]

    every = [*pair(0, voting=2, learned=3, oracle=4), *pair(1, voting=0, learned=2), *pair(2, learned=4, oracle=4)]
    rows = scored(pd.json_normalize([*every, *pair(3, voting=4), *pair(0, learned=4)]))  # the last one of a pair counts
    found = gain(rows[rows.method == "learned"])
    assert found is not None
    difference, closed, pairs = found
    assert (difference.value, closed, pairs) == (pytest.approx((0.5 + 0.5) / 2), pytest.approx(1.0), 2)
    assert gain(rows[(rows.method == "learned") & (rows["index"] == 2)]) is None


@pytest.mark.slow
def test_an_interval_covers_the_truth_as_often_as_it_says() -> None:
    rng = np.random.default_rng(0)
    covered = 0
    for _ in range(200):
        chance = np.clip(rng.normal(0.7, 0.15, 30), 0, 1).repeat(5)  # pairs of a building are alike
        cluster = [f"b{k}" for k in range(30) for _ in range(5)]
        found = ratio(rng.random(150) < chance, np.ones(150), cluster)
        assert found is not None and found.low <= found.value <= found.high
        covered += found.low <= 0.7 <= found.high
    assert 0.88 <= covered / 200 <= 0.99


def test_alike_pairs_of_few_buildings_are_known_less_well_than_of_many() -> None:
    values = np.repeat([0.0, 1.0, 1.0, 0.0, 1.0], 20)
    few = ratio(values, np.ones(100), [f"b{k // 20}" for k in range(100)])
    many = ratio(values, np.ones(100), [f"b{k}" for k in range(100)])
    assert few is not None and many is not None and few.value == many.value == 0.6
    assert few.high - few.low > 2 * (many.high - many.low)
    assert ratio([], [], []) is None and ratio([1.0], [0.0], ["b"]) is None


def test_the_bound_of_what_was_never_seen() -> None:
    assert upper_bound(0, 100) == pytest.approx(1 - 0.025 ** (1 / 100))
    assert upper_bound(3, 3) == upper_bound(0, 0) == 1.0
    assert upper_bound(2, 100) > upper_bound(1, 100)


def test_confidences_that_are_probabilities_have_no_calibration_error() -> None:
    rng = np.random.default_rng(0)
    confidence = rng.random(40_000)
    right = rng.random(40_000) < confidence
    bins = binned(confidence.tolist(), right.tolist())
    error = calibration_error(bins)
    assert error is not None and error < 0.01
    assert sum(b.count for b in bins) == 40_000
    overconfident = calibration_error(binned(np.full(1000, 0.95).tolist(), [k % 2 == 0 for k in range(1000)]))
    assert overconfident == pytest.approx(0.45)
    assert calibration_error(()) is None
    for bad in (1.01, -0.01, float("nan")):
        with pytest.raises(UserError, match="confidence"):
            binned([bad], [True])


def test_tables_have_a_line_for_every_regime_and_method() -> None:
    rows = frame(
        *(row(method=m, **{"pair.regime": r, "pair.rooms": n})
          for m in ("voting", "oracle") for r in ("drift", "real") for n in (2, None)),
        row(room_tally=tally(0, 0, 0), wall_tally=tally(0, 0, 0), **{"pair.regime": "negative"}),
        row(size=34, **{"pair.plan": "office_900001", "pair.plans": "office"}),
    )  # fmt: skip
    found = tables(rows)
    f1 = found["wall_f1_test_small"]
    assert isinstance(f1, pd.DataFrame) and list(f1.columns) == ["regime", "method", "2", "all", "pairs a cell"]
    lines = [(r, m) for r in ("real", "drift") for m in ("voting", "oracle")]
    assert list(zip(f1.regime, f1.method, strict=True)) == lines
    unique = found["unique_test_small"]
    assert isinstance(unique, pd.DataFrame)
    assert unique.iloc[-1].tolist()[:3] == ["negative", "voting", "100 % · 0/1"]
    # the generated plans with the first seeds are those that settings were chosen by
    assert {"wall_f1_validation_large", "wall_f1_office", "wall_f1_set"} < found.keys() > {"about_test_small"}
    assert found["about_validation_large"] == "1 plans of `office`, 34 to 34 rooms"


def test_twins_that_nothing_tells_apart_and_those_that_are_alike() -> None:
    rows = frame(
        row(twin=True, rival=0.2, status="ambiguous"), row(twin=True, rival=-3.0, status="none"),
        row(twin=True, rival=5.0), row(twin=True, rival=5.0, status="ambiguous"), row(), row(twin=None),
        row(method="oracle", twin=True, rival=0.2),
    )  # fmt: skip
    found = tables(rows)["symmetric"]
    assert isinstance(found, pd.DataFrame)
    equal, alike = found.to_numpy().tolist()
    assert equal == ["voting", "equal", "2", "0", "0", "0.0", "1", "1", "0"]
    assert alike[:5] == ["voting", "alike", "2", "1", "0"]
    assert "symmetric" not in tables(frame(row()))


def test_claims_are_of_plans_that_nothing_was_chosen_by() -> None:
    learned = [row(method="learned", **{"pair.regime": regime}) for regime in ("real", "drift", "negative")]
    chosen_by = row(method="learned", wrong=True, **{"pair.plans": "swiss_floors"})
    values = [claim.value for claim in claims(frame(*learned, chosen_by))]
    assert values[0].startswith("0.750") and values[2:] == ["0 of 3 (≤ 70.8 %)", "1 of 1 (≤ 100.0 %)"]


@pytest.mark.parametrize("nats", [0.5, 2.0, 4.0])
def test_how_often_measurements_tell_two_places_apart(nats: float) -> None:
    """Five walls, off by as many sigmas there as make so many nats to be expected, measured 40,000 times."""
    there = np.full(5, np.sqrt(2 * nats / 5))
    seen = np.random.default_rng(0).normal(size=(40_000, 5))
    evidence = 0.5 * ((seen - there) ** 2 - seen**2).sum(axis=1)
    told = to_be_sure([nats])
    assert (evidence > np.log(199)).mean() == pytest.approx(told, abs=0.01) and (told < 0.001) == (nats < 1)
