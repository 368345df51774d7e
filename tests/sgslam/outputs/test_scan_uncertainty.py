"""How probable it is that a scan's pose is within the limits, and what then counts as anchored."""

import csv
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from boxes import Array
from two_rooms import Run

from sgslam.backend import Uncertainty
from sgslam.config import Config, QualitySettings
from sgslam.session.scan_poses import ScanPose
from sgslam.session.soundness.scan_uncertainty import (
    ScanUncertainty,
    probability_within,
    scan_uncertainty,
    why_none_is_anchored,
)

LIMITS = np.array([0.5, 0.5, 0.5, *np.radians([5.0, 5.0, 5.0])])  # m and rad, the default settings
DEFAULT = QualitySettings()


@pytest.fixture(scope="module")
def run() -> Run:
    own = Run()
    own.optimise()
    return own


def told(
    run: Run, settings: QualitySettings = DEFAULT, lost: range = range(0), placed: bool = True, known: bool = True
) -> ScanUncertainty:
    """Of a run with a scan for each keyframe."""
    scans = [
        ScanPose(k.stamp_ns, k.T_map_sensor, k.T_map_sensor, i, np.eye(4), health="lost" if i in lost else "good")
        for i, k in enumerate(run.backend.keyframes)
    ]
    uncertainty: Uncertainty | None = run.backend.uncertainty() if known else None
    own: Any = SimpleNamespace(scans=scans, backend=run.backend)
    return scan_uncertainty(own, 0, uncertainty, np.eye(4) if placed else None, Config(quality=settings))


def test_the_probability_is_that_of_tables_of_the_normal_distribution() -> None:
    """Within 1.96 sigma along y are 95 %, within 2.576 sigma about x 99 %; others hardly count."""
    sigma = LIMITS / [60.0, 1.95996, 60.0, 2.57583, 60.0, 60.0]
    unknown = np.where(np.arange(6) == 2, np.nan, sigma)
    np.testing.assert_allclose(probability_within(np.array([sigma, unknown]), LIMITS), [0.95 * 0.99, 0.0], atol=1e-5)


@pytest.mark.parametrize("seed", range(4))
def test_correlated_errors_are_within_the_limits_at_least_as_often(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mixed = rng.normal(size=(6, 6)) * [4.0, 2.0, 1.0, 1.0, 1.0, 1.0]  # a few causes move all axes
    mixed *= (LIMITS / rng.uniform(1.5, 3.0, 6) / np.linalg.norm(mixed, axis=1))[:, None]
    stated = float(probability_within(np.linalg.norm(mixed, axis=1)[None], LIMITS)[0])
    errors = rng.normal(size=(20_000, 6)) @ mixed.T
    within = (np.abs(errors) <= LIMITS).all(axis=1).mean()
    assert 0.3 < stated < 0.95 and within >= stated - 3 * np.sqrt(stated * (1 - stated) / len(errors))


def test_lost_and_unknown_scans_and_those_without_a_place_have_no_probability(run: Run) -> None:
    sound = told(run)
    assert sound.anchored.all() and sound.probability.min() > 0.999
    some = told(run, lost=range(5, 20))
    assert np.flatnonzero(some.probability == 0.0).tolist() == list(range(5, 20))
    assert some.anchored.tolist() == (some.probability > 0).tolist()
    for own in (told(run, placed=False), told(run, known=False), told(run, lost=range(60))):
        assert not own.probability.any() and not own.anchored.any()


def test_a_scan_is_anchored_from_the_least_probability_on(run: Run) -> None:
    tight = QualitySettings(anchored_position=1.5 * float(np.median(told(run).sigma[:, :3].max(axis=1))))
    probability = told(run, tight).probability
    middle = int(np.argsort(probability)[30])
    assert 0.1 < probability[middle] < 0.9
    for factor, anchored in ((0.999, True), (1.0, True), (1.001, False)):
        least = tight.model_copy(update={"anchored_probability": factor * probability[middle]})
        own = told(run, least)
        assert own.anchored[middle] == anchored and 0.3 < own.anchored.mean() < 0.7


def test_the_file_has_the_probability_of_each_scan_in_the_order_of_stamps(run: Run, tmp_path: Path) -> None:
    early = told(run)
    late = replace(early, probability=np.full(60, 0.98765), anchored=np.zeros(60, dtype=np.bool_))
    early = replace(early, stamps_ns=early.stamps_ns - 10**11)
    joined = ScanUncertainty.joined([late, early])
    joined.write_csv(tmp_path / "sigma.csv")
    with (tmp_path / "sigma.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["probability"] for row in rows] == ["1.0000"] * 60 + ["0.9877"] * 60
    assert [row["anchored"] for row in rows] == ["1"] * 60 + ["0"] * 60
    assert {row["health"] for row in rows} == {"good"} and list(rows[0])[-3:] == ["probability", "anchored", "health"]


def spread(*largest: float) -> Array:
    """(200, 6) sigmas between a half of the `largest` (m, degrees) and these, which differ from axis to axis."""
    highest = np.array([*largest[:3], *np.radians(largest[3:])])
    return np.asarray(highest * np.random.default_rng(1).uniform(0.5, 1.0, (200, 6)))


@pytest.mark.parametrize(
    ("sigma", "named"),
    [
        (spread(0.01, 0.01, 2.3, 0.1, 0.1, 0.1), "quality.anchored_position"),
        (spread(0.6, 0.5, 0.6, 0.1, 0.1, 0.1), "quality.anchored_position"),
        (spread(0.01, 0.01, 0.01, 0.1, 0.1, 12.0), "heading"),
        (spread(0.01, 0.9, 0.7, 0.1, 7.0, 8.0), "position along y"),
    ],
)
def test_what_is_known_worst_is_named(sigma: Array, named: str) -> None:
    n = len(sigma)
    parts = np.zeros(n, dtype=np.int64)
    own = ScanUncertainty(
        parts, sigma, parts, np.full(n, ""), np.zeros(n), np.zeros(n, dtype=np.bool_), np.full(n, "good")
    )
    assert named in why_none_is_anchored(own, DEFAULT)
