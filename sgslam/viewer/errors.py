"""Live position errors of a run against the ground truth."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from data.trajectory import Trajectory
from sgslam.geometry.frames import inverse
from sgslam.report import associate

Floats = NDArray[np.float64]
Lines: TypeAlias = tuple[Floats, dict[str, Floats]]
LIVE, CURRENT = "live", "current estimate"


class LiveErrors:
    """Position errors against `truth` (T_bim_sensor).

    While the map is not anchored, its first pose is set to the true one, so that the error is the drift.
    """

    def __init__(self, truth: Trajectory) -> None:
        self._truth = truth
        self._stamps: list[int] = []
        self._poses: list[Floats] = []
        self._places: list[Floats | None] = []

    def add(self, stamp_ns: int, T_map_sensor: Floats, T_bim_map: Floats | None) -> None:
        """Adds the live pose of a scan."""
        self._stamps.append(stamp_ns)
        self._poses.append(T_map_sensor)
        self._places.append(T_bim_map)

    def lines(self, keyframes_ns: NDArray[np.int64], keyframes: Floats, T_bim_map: Floats | None) -> Lines:
        """Seconds (N,) since the first scan, and errors (N,) in metres by name: of the live poses, and of the current
        trajectory through the keyframes (K, 4, 4) T_map_sensor. NaN where there is no truth."""
        count = len(self._stamps)  # the run may add scans meanwhile
        stamps, poses = np.array(self._stamps[:count], dtype=np.int64), np.array(self._poses[:count])
        ours, true = associate(stamps, self._truth.stamps_ns)
        if not len(ours):
            return np.empty(0), {}
        start = self._truth.poses[true[0]] @ inverse(poses[ours[0]])
        T = np.array([start if place is None else place for place in self._places[:count]])
        places = (T @ poses[:, :, 3, None])[:, :3, 0]
        live = np.full(count, np.nan)
        live[ours] = np.linalg.norm(places[ours] - self._truth.positions[true], axis=1)
        seconds = (stamps - stamps[0]) / 1e9
        current = self._of_keyframes(keyframes_ns, keyframes, start if T_bim_map is None else T_bim_map)
        known = np.isfinite(current)
        if not known.any():
            return seconds, {LIVE: live}
        at = (keyframes_ns[known] - stamps[0]) / 1e9
        return seconds, {LIVE: live, CURRENT: np.interp(seconds, at, current[known])}

    def _of_keyframes(self, stamps: NDArray[np.int64], poses: Floats, T_bim_map: Floats) -> Floats:
        errors = np.full(len(stamps), np.nan)
        ours, true = associate(stamps, self._truth.stamps_ns)
        places = (T_bim_map @ poses[ours][:, :, 3, None])[:, :3, 0]
        errors[ours] = np.linalg.norm(places - self._truth.positions[true], axis=1)
        return errors


def rms(errors: Floats) -> float:
    """The root mean square of the finite values; NaN if there are none."""
    known = errors[np.isfinite(errors)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")
