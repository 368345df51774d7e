"""Adjusts a finished map to the plan, keyframes and walls jointly, by all points that the keyframes saw."""

import logging

import numpy as np
from numpy.typing import NDArray

from sgslam.adjustment import Steps, faces_of, pose_errors, wall_points
from sgslam.config import AnchorSettings, Config
from sgslam.geometry.frames import inverse, se2_to_se3
from sgslam.mapping import SMOOTHED
from sgslam.session.active_map import ActiveMap

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)


def adjust(final: ActiveMap, config: Config) -> None:
    """Moves the keyframes of a map that is anchored to a building; does nothing to another."""
    backend, anchoring = final.backend, final.anchoring
    T_bim_map = final.T_bim_map
    if not config.anchors.points or T_bim_map is None or anchoring is None or backend.T_map_bim is None:
        return
    with final.stopwatch("adjustment"):
        errors = _pose_errors(final, T_bim_map @ backend.poses, config.anchors)
        local = inverse(backend.T_map_bim) @ backend.poses
        settled = np.stack([_without(T, error) for T, error in zip(local, errors, strict=True)])
    moved = float(np.sqrt(np.mean(np.sum(errors[:, :2] ** 2, axis=1))))
    _log.info("keyframes and walls are adjusted jointly: the keyframes move by %.1f mm", 1000 * moved)
    final.settle(settled)


def _pose_errors(final: ActiveMap, poses: Floats, settings: AnchorSettings) -> Floats:
    assert final.anchoring is not None
    faces = faces_of(final.anchoring.a_graph)
    seen = wall_points(faces, ((T, final.clouds[k]) for k, T in enumerate(poses)))
    return pose_errors(faces, seen, _steps(final, poses), settings.sigma_offset, settings.sigma_extraction)


def _steps(final: ActiveMap, poses: Floats) -> Steps:
    shift = np.diff(poses[:, :2, 3], axis=0, prepend=poses[:1, :2, 3])
    sigma, turn = np.full(len(poses), np.inf), np.full(len(poses), np.inf)
    for k, (T, keyframe) in enumerate(zip(poses, final.backend.keyframes, strict=True)):
        if final.backend.has_step(k):
            share = SMOOTHED if keyframe.smoothed else 1.0
            R, covariance = T[:3, :3], keyframe.step_covariance
            sigma[k] = share * np.sqrt(np.trace((R @ covariance[3:, 3:] @ R.T)[:2, :2]) / 2)
            turn[k] = share * np.sqrt((R @ covariance[:3, :3] @ R.T)[2, 2])
    return Steps(shift, sigma, turn)


def _without(T_plan_sensor: Floats, error: Floats) -> Floats:
    """The pose (4, 4) without its error (3,) in x, y and heading."""
    turned = se2_to_se3(-error[2], 0.0, 0.0)[:3, :3]
    T = T_plan_sensor.copy()
    T[:3, :3] = turned @ T[:3, :3]
    T[:2, 3] -= error[:2]
    return T
