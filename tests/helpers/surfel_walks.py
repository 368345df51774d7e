"""Surfels as a tracker has them after its first seconds: rays cast while someone walks, gathered in voxels."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from data.geometry.raycast import TriangleScene

Array = NDArray[np.float64]
SECONDS = 5.0
SWAY = np.radians([3.0, 3.0, 4.0])  # about x, y, z, at the rate of steps
BOB = 0.03  # m
FLATTEST = 0.04  # m: standard deviation across a voxel's plane, at most
FEWEST = 8  # points


@dataclass(frozen=True)
class Surfels:
    """In the frame of the first sensor pose: positions and normals (N, 3), weights (N,), the sensor's positions (M, 3);
    `up` (3,) is the truth."""

    positions: Array
    normals: Array
    weights: Array
    sensor_positions: Array
    up: Array


def rings(lowest_deg: float, highest_deg: float, beams: int, azimuths: int) -> Array:
    """(N, 3) directions of a spinning sensor."""
    a, e = np.meshgrid(
        np.linspace(-np.pi, np.pi, azimuths, endpoint=False), np.radians(np.linspace(lowest_deg, highest_deg, beams))
    )
    return np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1).reshape(-1, 3)


def tilted(degrees: float, rng: np.random.Generator) -> Array:
    """(3, 3) a mount's rotation about a random level axis."""
    angle = rng.uniform(-np.pi, np.pi)
    return Rotation.from_rotvec(np.radians(degrees) * np.array([np.cos(angle), np.sin(angle), 0.0])).as_matrix()


def swaying(level: Array, mount: Array, rng: np.random.Generator) -> Array:
    """(N, 4, 4) sensor poses of one who carries it along level poses (N, 4, 4); `mount` (3, 3) is R_carrier_sensor."""
    seconds = np.linspace(0.0, SECONDS, len(level))[:, None]
    phase = 2 * np.pi * (1.0 * seconds + rng.random(3))
    poses = level.copy()
    poses[:, :3, :3] = level[:, :3, :3] @ Rotation.from_euler("xyz", SWAY * np.sin(phase)).as_matrix() @ mount
    poses[:, 2, 3] += BOB * np.sin(2 * phase[:, 0])
    return poses


def surfels_seen(
    scene: TriangleScene, T_bim_sensor: Array, directions: Array, rng: np.random.Generator, voxel: float = 0.5
) -> Surfels:
    """What a sensor with these directions (N, 3) gathers from these poses (M, 4, 4); 2 cm noise, reach 30 m."""
    seen, origins = [], []
    for T in T_bim_sensor:
        rays = directions @ T[:3, :3].T
        ranges = scene.distances(T[:3, 3], rays)
        hit = (ranges > 0.3) & (ranges < 30.0)
        seen.append(T[:3, 3] + rays[hit] * (ranges[hit] + rng.normal(0.0, 0.02, int(hit.sum())))[:, None])
        origins.append(np.tile(T[:3, 3], (len(seen[-1]), 1)))
    first = T_bim_sensor[0]
    points, froms = ((np.concatenate(p) - first[:3, 3]) @ first[:3, :3] for p in (seen, origins))
    positions, normals, counts = _planes(points, froms, voxel)
    way = (T_bim_sensor[:, :3, 3] - first[:3, 3]) @ first[:3, :3]
    return Surfels(positions, normals, counts, way, first[2, :3].copy())


def _planes(points: Array, froms: Array, voxel: float) -> tuple[Array, Array, Array]:
    """Mean, normal turned to the sensor, and number of points of each flat voxel; both faces of a wall are kept."""
    cells = np.floor(points / voxel).astype(np.int64) + 2048
    _, of = np.unique(cells @ np.array([4096**2, 4096, 1]), return_inverse=True)
    _, _, vectors, _ = _moments(points, of)
    side = np.einsum("nk,nk->n", vectors[of, :, 0], froms - points) > 0
    _, of = np.unique(2 * of + side, return_inverse=True)
    mean, values, vectors, counts = _moments(points, of)
    origin, _, _, _ = _moments(froms, of)
    flat = (counts >= FEWEST) & (values[:, 0] < FLATTEST**2) & (values[:, 0] < 0.1 * values[:, 1])
    normals = vectors[flat, :, 0]
    away = np.einsum("nk,nk->n", normals, mean[flat] - origin[flat]) > 0
    return mean[flat], np.where(away[:, None], -normals, normals), counts[flat]


def _moments(points: Array, of: NDArray[np.int64]) -> tuple[Array, Array, Array, Array]:
    """Mean, eigenvalues and eigenvectors of the covariance, and number of points of each voxel."""
    counts = np.bincount(of).astype(float)
    mean = np.stack([np.bincount(of, points[:, k]) for k in range(3)], axis=1) / counts[:, None]
    off = points - mean[of]
    pairs = [np.bincount(of, off[:, i] * off[:, j]) / counts for i in range(3) for j in range(3)]
    values, vectors = np.linalg.eigh(np.stack(pairs, axis=1).reshape(-1, 3, 3))
    return mean, values, vectors, counts
