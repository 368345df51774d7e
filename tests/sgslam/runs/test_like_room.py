"""A sensor that was lost, and is found again in a room like its own: the run is not sure of it at first."""

from pathlib import Path

import numpy as np
import pytest
from boxes import Array, Box, pose, room, scan, scene_of
from drives import fed

from sgslam.config import Config
from sgslam.config.tracking_settings import TrackingSettings
from sgslam.session import Checkpoints
from sgslam.session.checkpoints import load
from sgslam.slam import SceneGraphSlam

pytestmark = pytest.mark.slow
SEEN, CAPPED, LIKE, ELSEWHERE = 60, 8, 20, 30  # scans
FOUND, LEFT = SEEN + CAPPED, SEEN + CAPPED + LIKE


def scans(*, stays: bool) -> list[tuple[int, Array]]:
    """From a corridor into a room; under a cap it may have been carried to a like one; then, unless it `stays`, in one
    that is not."""
    inner, corridor = room(0, 0, 6, 5), room(6.2, -3, 8.2, 8)
    doorway: list[Box] = [(6, 0, 0, 6.2, 2, 2.6), (6, 3, 0, 6.2, 5, 2.6), (6, 2, 2.1, 6.2, 3, 2.6)]
    cupboard: Box = (1, 4, 0, 2, 5, 2)
    here = scene_of([*inner[:3], *inner[4:], *corridor[:2], *corridor[3:], *doorway, cupboard])
    there = scene_of([*room(20, 0, 29, 7), (23, 2, 0, 24, 4, 2.6), (26, 5, 0, 27, 7, 2.6)])
    points = [scan(here, pose(8.0 - 0.09 * k, 2.5, 1, yaw=np.pi), seed=k) for k in range(SEEN)]
    points += [0.4 * np.random.default_rng(k).normal(size=(20, 3)) for k in range(CAPPED)]
    last = LEFT + (ELSEWHERE if stays else 0)
    points += [scan(here, pose(2.7, 2.5, 1, yaw=np.pi), seed=k) for k in range(FOUND, last)]
    points += [scan(there, pose(25 + 0.03 * k, 2, 1, yaw=1 - 0.03 * k), seed=k) for k in range(LEFT + ELSEWHERE - last)]
    return [(10**8 * k, own) for k, own in enumerate(points)]


def slam(unconfirmed: float, unseen: float = 2.0) -> SceneGraphSlam:
    settings = TrackingSettings(unconfirmed=unconfirmed, unseen=unseen, gravity_until=5.0)
    return SceneGraphSlam(config=Config(tracking=settings))


@pytest.mark.parametrize(
    ("unconfirmed", "part_of_like_room"), [(LIKE / 10 - 0.5, 0), pytest.param(10.0, 1, marks=pytest.mark.long)]
)
def test_a_place_that_soon_proves_wrong_is_not_believed(unconfirmed: float, part_of_like_room: int) -> None:
    told = fed(slam(unconfirmed), scans(stays=False)).finish().uncertainty
    like, other = [part_of_like_room] * LIKE, [part_of_like_room + 1] * ELSEWHERE
    assert told.part.tolist() == [0] * FOUND + like + other
    assert set(told.health[SEEN:FOUND]) == {"lost"} and "lost" not in told.health[FOUND:LEFT]


def test_a_sensor_that_stayed_is_not_sure_for_a_time_and_goes_on() -> None:
    run = slam(2.0)
    healths = [run.add_scan(*own).health for own in scans(stays=True)]
    assert healths[FOUND : FOUND + 21] == ["lost"] * 21 and set(healths[FOUND + 21 :]) == {"good"}
    result = run.finish()
    assert run.kidnaps == 0 and not result.uncertainty.part.any()
    assert set(result.uncertainty.health[FOUND:]) == {"good"}


@pytest.mark.parametrize(("unseen", "part"), [(CAPPED / 10 + 0.05, 0), (CAPPED / 10 - 0.05, 1)])
def test_a_sensor_whose_way_was_unseen_for_long_begins_a_new_part(unseen: float, part: int) -> None:
    told = fed(slam(2.0, unseen), scans(stays=True)).finish().uncertainty
    assert told.part.tolist() == [0] * FOUND + [part] * (LIKE + ELSEWHERE)
    assert set(told.health[SEEN:FOUND]) == {"lost"} and "lost" not in told.health[FOUND:]


@pytest.mark.long
def test_a_saved_run_remembers_that_it_is_not_sure(tmp_path: Path) -> None:
    first, second = fed(slam(10.0), scans(stays=False)[: FOUND + 10]), slam(10.0)
    Checkpoints(tmp_path, {}).write(first, {})
    load(tmp_path, second)
    told = fed(second, scans(stays=False)[FOUND + 10 :]).finish().uncertainty
    assert told.part.tolist() == [0] * FOUND + [1] * LIKE + [2] * ELSEWHERE
