"""What a run leaves behind, poses with their uncertainty and health, and all measures that follow from it."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.trajectory import Trajectory
from evaluation.metrics.tracking import errors_over_time, step_errors
from evaluation.metrics.trajectories import ape, error_in_bim, inside_95, wrong_poses
from evaluation.study import Record

Array = NDArray[np.float64]
WRONG_STOREY_M = 1.5  # error in height from which a storey is wrong
FRAMES = ("truth", "anchored", "map", "odometry", "live")
NO_POSES = Trajectory(np.empty(0, np.int64), np.empty((0, 4, 4)))


@dataclass(frozen=True, eq=False)
class Outcome:
    """A run of `scans` scans.

    Trajectories: the `truth` T_bim_sensor, at the scans' stamps and some after them; `anchored` T_bim_sensor of the
    scans that the run anchors; `map` and `odometry` of all scans, in frames of their own; `live` T_bim_sensor as they
    were known when the scans came. `sigma` (S, 6) and `health` (S,) belong to `stamps_ns` (S,), all scans: standard
    deviations along (m) and about (rad) x, y, z. `facts` are what does not follow from poses, as JSON values; a run
    with `no_place` is wrong wherever it is anchored.
    """

    scans: int
    truth: Trajectory
    anchored: Trajectory = NO_POSES
    map: Trajectory = NO_POSES
    odometry: Trajectory = NO_POSES
    live: Trajectory = NO_POSES
    stamps_ns: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    sigma: Array = field(default_factory=lambda: np.empty((0, 6)))
    health: tuple[str, ...] = ()
    no_place: bool = False
    facts: Mapping[str, Any] = field(default_factory=dict)

    def save(self, path: Path) -> None:
        """Writes an .npz file."""
        arrays: dict[str, Any] = {"stamps_ns": self.stamps_ns, "sigma": self.sigma}
        for name in FRAMES:
            trajectory = getattr(self, name)
            arrays |= {f"{name}_ns": trajectory.stamps_ns, f"{name}_poses": trajectory.poses}
        about = {"scans": self.scans, "health": self.health, "no_place": self.no_place, "facts": dict(self.facts)}
        path.parent.mkdir(parents=True, exist_ok=True)
        unfinished = path.with_suffix(".part.npz")
        np.savez_compressed(unfinished, about=json.dumps(about), **arrays)
        unfinished.rename(path)

    @staticmethod
    def load(path: Path) -> "Outcome":
        """Reads what `save` wrote."""
        with np.load(path) as file:
            about = json.loads(str(file["about"]))
            frames: dict[str, Any] = {name: Trajectory(file[f"{name}_ns"], file[f"{name}_poses"]) for name in FRAMES}
            about["health"] = tuple(about["health"])
            return Outcome(**about, **frames, stamps_ns=file["stamps_ns"], sigma=file["sigma"])

    def measures(self) -> Record:
        """All measures that follow from the poses, and the facts; None where there is nothing to measure.

        `anchored`; `wrong_storey`: anchored more than 1.5 m too high or low at any scan, live or in the end;
        `anchored_scans`, of which `wrong` ones are off by more than 0.5 m or 5 degrees, and their
        `coverage` of all scans; `silent`: wrong without an alarm. In the BIM frame without alignment: the RMSE in space
        (`rmse_m`), in `plan_view_m`, in height (`height_m`) and in yaw, and the `worst_m`.
        `inside`: how often errors are in their 95 % regions. `ate_m` and `odometry_ate_m` are RMSEs of map and
        odometry after SE(3) alignment. `second_*` are errors of the odometry's motion over a second (median, 95 %),
        `worst_step_m` the largest between neighbouring scans, `missing` the scans without a pose.
        """
        count, wrong = len(self.anchored), self._wrong(self.anchored)
        lost = sum(health == "lost" for health in self.health)
        return {
            "scans": self.scans,
            "anchored": bool(count),
            "anchored_scans": count,
            "coverage": count / self.scans if count else None,
            "wrong": wrong,
            "wrong_live": self._wrong(self.live),
            "wrong_storey": any(_off_in_height(poses, self.truth) for poses in (self.anchored, self.live)),
            "silent": bool(wrong and not self.facts.get("alarms")),
            "lost": lost,
            **self._in_bim(),
            "ate_m": _ate(self.map, self.truth),
            "odometry_ate_m": _ate(self.odometry, self.truth),
            **self._tracking(),
            **self.facts,
        }

    def _wrong(self, poses: Trajectory) -> int:
        return len(poses) if self.no_place else wrong_poses(poses, self.truth)

    def _in_bim(self) -> Record:
        if not len(self.anchored):
            return {}
        error = error_in_bim(self.anchored, self.truth)
        kept = np.isin(self.stamps_ns, self.anchored.stamps_ns)
        region = inside_95(self.anchored, self.truth, self.sigma[kept]) if kept.sum() == len(self.anchored) else None
        return {
            "rmse_m": error.position.rmse,
            "plan_view_m": error.horizontal.rmse,
            "height_m": error.height.rmse,
            "worst_m": error.position.max,
            "yaw_deg": float(np.degrees(error.yaw.rmse)),
            "inside": None if region is None or self.no_place else region.model_dump(),
        }

    def _tracking(self) -> Record:
        if len(self.odometry) < 2:
            return {}
        motion = errors_over_time(self.odometry, self.truth)
        metres, degrees = motion.translation_m, np.degrees(motion.rotation_rad)
        return {
            "missing": self.scans - len(self.odometry),
            "second_m": float(np.median(metres)),
            "second_95_m": float(np.percentile(metres, 95)),
            "second_deg": float(np.median(degrees)),
            "worst_step_m": float(step_errors(self.odometry, self.truth).translation_m.max()),
        }


def _off_in_height(poses: Trajectory, truth: Trajectory) -> bool:
    off = poses.positions[:, 2] - truth.at(poses.stamps_ns)[:, 2, 3]
    return bool((np.abs(off) > WRONG_STOREY_M).any())


def _ate(found: Trajectory, truth: Trajectory) -> float | None:
    """The RMSE (m) after SE(3) alignment; None for too little motion."""
    at = found.stamps_ns
    return _known(lambda: ape(found, Trajectory(at, truth.at(at)), "se3").translation.rmse) if len(found) else None


def _known(measure: Any) -> float | None:
    """What is measured; None where the sensor moved too little."""
    try:
        value = measure()
    except UserError:
        return None
    return None if value is None else float(value)
