"""What the matching benchmark says of rows: counts by hand, intervals that cover, calibrated confidences."""

import dataclasses
import json
from typing import Any

import numpy as np
import pytest
from evaluation.matching_benchmark.cells import measure
from evaluation.matching_benchmark.rows import Row, Tally, appending, read_rows

from data import SceneGraph, WallSurface
from data.common.errors import UserError
from evaluation.matching_benchmark import symmetries as matching_symmetries
from evaluation.matching_benchmark.judge import is_wrong, tallies
from evaluation.matching_benchmark.tables import full_tables, latex, tables
from evaluation.metrics.bootstrap import ratio, upper_bound
from evaluation.metrics.calibration import binned, calibration_error, merged
from evaluation.metrics.true_matches import TrueMatches
from matching.result import MatchResult

WALLS = tuple(WallSurface(name, None, (0.0, 0.0), (1.0, 0.0), 1.0) for name in ("one", "two", "cupboard", "shelf"))
S = SceneGraph("map", (), WALLS)
TRUTH = TrueMatches({}, {"one": "a", "two": "b"}, (0.0, 0.0, 0.0), None, (0.0, 0.0))


def row(**changes: Any) -> Row:
    known: dict[str, Any] = dict(
        method="voting", regime="real", plans="set", plan="p", building="b", source="set/p", rooms=2, index=0, seed=0,
        size=10, s_rooms=2, s_walls=8, status="unique", reason="", wrong=False, twin=False, rival=None, seconds=0.1,
        room_tally=Tally(2, 2, 2), wall_tally=Tally(6, 8, 8),
    )  # fmt: skip
    return Row(**known | changes)


def test_the_tally_of_an_answer() -> None:
    result = MatchResult("unique", "", (), (("one", "a", 0.97), ("two", "c", 0.91), ("shelf", "a", 0.2)))
    rooms, walls = tallies(result, TRUTH, S)
    assert rooms == Tally()
    # the shelf is matched though it is in no plan, the cupboard is left alone
    assert (walls.right, walls.answered, walls.true, walls.spare, walls.left) == (1, 3, 2, 2, 1)
    assert [(b.index, b.count, b.right) for b in walls.bins] == [(4, 1, 0), (18, 1, 0), (19, 1, 1)]


def test_every_unique_answer_is_wrong_where_nothing_of_the_map_is_in_the_plan() -> None:
    nothing = dataclasses.replace(TRUTH, wall_surfaces={})
    assert is_wrong(MatchResult("unique", "", T_a_s=(0.0, 0.0, 0.0)), nothing, bent=False)
    assert not is_wrong(MatchResult("ambiguous", "", T_a_s=(0.0, 0.0, 0.0)), nothing, bent=False)


def test_the_measures_of_three_pairs_by_hand() -> None:
    rows = [
        row(wall_tally=Tally(8, 8, 8, 2, 2), building="x"),
        row(wall_tally=Tally(3, 6, 6, 2, 0), building="x", status="ambiguous", twin=True),
        row(wall_tally=Tally(0, 0, 2), room_tally=Tally(0, 0, 2), building="y", status="late", seconds=60.0),
    ]
    m = measure(rows)
    assert m.walls.precision is not None and m.walls.precision.value == pytest.approx((1 + 0.5) / 2)  # of two answers
    assert m.walls.recall is not None and m.walls.recall.value == pytest.approx((1 + 0.5 + 0) / 3)
    assert m.walls.f1 is not None and m.walls.f1.value == pytest.approx((1 + 0.5 + 0) / 3)
    assert m.walls.micro_f1 is not None and m.walls.micro_f1.value == pytest.approx(2 * 11 / (14 + 16))
    assert m.walls.accuracy is not None and m.walls.accuracy.value == pytest.approx((1 + 3 / 8 + 0) / 3)
    shares = [s and s.value for s in (m.unique, m.ambiguous, m.none, m.decided, m.perfect)]
    assert shares == pytest.approx([1 / 3, 1 / 3, 0, 1 / 2, 1 / 3])
    assert (m.pairs, m.uniques, m.wrong, m.failed) == (3, 1, 0, 0)
    assert (m.median_s, m.completed) == (0.1, pytest.approx(2 / 3))


def test_what_there_is_nothing_of_is_not_measured() -> None:
    m = measure(
        [row(regime="negative", twin=None, wrong=True, room_tally=Tally(0, 1), wall_tally=Tally(0, 3, 0, 4, 1))]
    )
    assert m.walls.f1 is None and m.walls.recall is None and m.perfect is None and m.decided is None
    assert m.walls.accuracy is not None and m.walls.accuracy.value == 0.25
    assert (m.wrong, m.uniques) == (1, 1)


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
    halves = [binned(confidence[k::2].tolist(), right[k::2].tolist()) for k in (0, 1)]
    error = calibration_error(merged(halves))
    assert error is not None and error < 0.01
    assert sum(b.count for b in merged(halves)) == 40_000
    overconfident = calibration_error(binned(np.full(1000, 0.95).tolist(), [k % 2 == 0 for k in range(1000)]))
    assert overconfident == pytest.approx(0.45)
    assert calibration_error(()) is None
    for bad in (1.01, -0.01, float("nan")):
        with pytest.raises(UserError, match="confidence"):
            binned([bad], [True])


def test_rows_come_back_and_a_half_written_one_is_dropped(tmp_path: Any) -> None:
    path = tmp_path / "rows.jsonl"
    first = row(wall_tally=Tally(1, 2, 3, 4, 4, binned([0.5, 1.0], [True, False])), rooms=None, twin=None)
    second = row(index=1)
    with appending(path) as append:
        append(first)
        append(second)
    assert read_rows(path) == [first, second]
    path.write_bytes(path.read_bytes()[:-7])
    assert read_rows(path) == [first]
    with appending(path) as append:
        append(second)
    assert read_rows(path) == [first, second]
    path.write_text(json.dumps({"method": "voting"}) + "\n")
    with pytest.raises(UserError, match=r"rows\.jsonl:1"):
        read_rows(path)


def test_tables_have_a_line_for_every_regime_and_method_and_escape_what_latex_reads() -> None:
    rows = [
        row(method=m, regime=r, rooms=n) for m in ("voting", "oracle") for r in ("real", "drift") for n in (2, None)
    ]
    rows += [row(regime="negative", room_tally=Tally(), wall_tally=Tally()), row(size=34, plan="my_plan", plans="a_b")]
    short, full = tables(rows), full_tables(rows)
    f1 = next(t for t in short if t.title.startswith("Wall F1, small"))
    assert f1.header == ("regime", "method", "2", "all", "pairs a cell")
    assert [line[:2] for line in f1.lines] == [(r, m) for r in ("real", "drift") for m in ("voting", "oracle")]
    unique = next(t for t in short if t.title.startswith("Unique") and "small" in t.title)
    assert unique.lines[-1][:3] == ("negative", "voting", "100 % · 0/1")
    for table in (*short, *full):
        assert all(len(line) == len(table.header) for line in table.lines)
        assert "_" not in latex(table).replace("\\_", "")
    assert {t.title.split(",")[1].split()[0] for t in short if t.title.startswith("Wall")} == {"small", "large"}


def test_twins_that_nothing_tells_apart_and_those_that_are_alike() -> None:
    rows = [
        row(twin=True, rival=0.2, status="ambiguous"), row(twin=True, rival=-3.0, status="none"),
        row(twin=True, rival=5.0), row(twin=True, rival=5.0, status="ambiguous"), row(), row(twin=None),
        row(method="oracle", twin=True, rival=0.2),
    ]  # fmt: skip
    equal, alike = matching_symmetries.lines(rows)
    assert equal[:5] == ("voting", "equal", "2", "0", "0") and equal[6:] == ("1", "1")
    assert alike[:5] == ("voting", "alike", "2", "1", "0") and equal[5] == "0.0"
    assert "Symmetric plans" in {t.title for t in tables(rows)}
    assert "Symmetric plans" not in {t.title for t in tables([row()])}


@pytest.mark.parametrize("nats", [0.5, 2.0, 4.0])
def test_how_often_measurements_tell_two_places_apart(nats: float) -> None:
    """Five walls, off by as many sigmas there as make so many nats to be expected, measured 40,000 times."""
    there = np.full(5, np.sqrt(2 * nats / 5))
    seen = np.random.default_rng(0).normal(size=(40_000, 5))
    evidence = 0.5 * ((seen - there) ** 2 - seen**2).sum(axis=1)
    told = matching_symmetries.to_be_sure([row(twin=True, rival=nats)])
    assert (evidence > np.log(199)).mean() == pytest.approx(told, abs=0.01) and (told < 0.001) == (nats < 1)
