"""The normals that a scan itself shows: a ring of beams shows none, several rings on one wall do."""

import numpy as np
import pytest

from sgslam.registration.sampling import normals_at

NOISE = 0.02  # m along the beam
_PATCH = 0.25  # m
RING = np.radians(15.0)


def rings_on_wall(elevations_deg: list[float], distance: float, seed: int) -> np.ndarray:
    """(N, 3) what some rings see of a wall ahead, within one cell in width."""
    rng = np.random.default_rng(seed)
    azimuth = np.linspace(0.01, 0.23, 40) / distance
    found = []
    for elevation in np.radians(elevations_deg):
        ray = np.c_[np.ones(40), np.tan(azimuth), np.full(40, np.tan(elevation)) / np.cos(azimuth)]
        found.append(ray * (distance + rng.normal(0, NOISE, (40, 1))))
    return np.concatenate(found)


@pytest.mark.parametrize("seed", range(8))
def test_one_ring_shows_no_normal(seed: int) -> None:
    """Its points spread along their rays by noise, and so do not show the cone that they lie on."""
    points = rings_on_wall([15.0], 2.6, seed)
    assert not normals_at(points, np.arange(len(points)), _PATCH).any()


@pytest.mark.parametrize("seed", range(8))
def test_rings_a_hand_apart_show_the_wall(seed: int) -> None:
    points = rings_on_wall([11.5, 13.5, 15.5], 2.6, seed) - np.array([0.0, 0.0, 0.51])
    normals = normals_at(points, np.arange(len(points)), _PATCH)
    shown = normals[np.abs(normals).any(axis=1)]
    assert len(shown) > 0.5 * len(points)
    assert (np.abs(shown[:, 0]) > 0.9).all()
