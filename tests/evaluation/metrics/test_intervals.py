"""Intervals that cover, bounds of what was never seen, and confidences that are probabilities."""

import numpy as np
import pytest

from data.common.errors import UserError
from evaluation.metrics.statistics import Score, Statistics, binned, calibration_error, ratio, upper_bound


def test_statistics_of_known_errors() -> None:
    assert Statistics.of(np.array([3.0, -4.0, 0.0, 5.0])) == Statistics(np.sqrt(12.5), 3.5, 5.0)
    with pytest.raises(UserError, match="no statistics"):
        Statistics.of(np.array([1.0, np.nan]))
    score, nothing = Score(3, 4, 3, 6), Score(0, 0, 0, 6)
    assert (score.precision, score.recall, score.f1) == (0.75, 0.5, pytest.approx(0.6))
    assert (nothing.precision, nothing.recall, nothing.f1) == (None, 0, 0)
    assert Score(0, 0, 0, 0).f1 is None and Score(0, 2, 0, 0).f1 is None


def test_an_interval_covers_the_truth_as_often_as_it_says() -> None:
    rng, covered = np.random.default_rng(0), 0
    for _ in range(200):
        chance = np.clip(rng.normal(0.7, 0.15, 30), 0, 1).repeat(5)  # pairs of a building are alike
        found = ratio(rng.random(150) < chance, np.ones(150), [f"b{k // 5}" for k in range(150)])
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
    assert upper_bound(3, 3) == upper_bound(0, 0) == 1.0 > upper_bound(2, 100) > upper_bound(1, 100)


def test_confidences_that_are_probabilities_have_no_calibration_error() -> None:
    rng = np.random.default_rng(0)
    confidence = rng.random(40_000)
    bins = binned(confidence.tolist(), (rng.random(40_000) < confidence).tolist())
    error = calibration_error(bins)
    assert error is not None and error < 0.01 and sum(b.count for b in bins) == 40_000
    overconfident = calibration_error(binned(np.full(1000, 0.95).tolist(), [k % 2 == 0 for k in range(1000)]))
    assert overconfident == pytest.approx(0.45) and calibration_error(()) is None
    for bad in (1.01, -0.01, float("nan")):
        with pytest.raises(UserError, match="confidence"):
            binned([bad], [True])
