"""How far off a run is while it goes on, where the truth is known."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from data.trajectory import Trajectory
from sgslam.geometry.frames import inverse
from sgslam.report.accuracy import associate

Floats = NDArray[np.float64]
Lines: TypeAlias = tuple[Floats, dict[str, Floats]]
CAME, KNOWN = "when it came", "as known now"


class LiveErrors:
    """Position errors against `truth` (T_bim_sensor). While the map's place in the BIM is not known it is taken to
    begin at the true pose, so that what is told is its drift."""

    def __init__(self, truth: Trajectory) -> None:
        self._truth = truth
        self._stamps: list[int] = []
        self._poses: list[Floats] = []
        self._places: list[Floats | None] = []

    def note(self, stamp_ns: int, T_map_sensor: Floats, T_bim_map: Floats | None) -> None:
        """Takes note of a scan's pose as it is known right after it."""
        self._stamps.append(stamp_ns)
        self._poses.append(T_map_sensor)
        self._places.append(T_bim_map)

    def lines(self, keyframes_ns: NDArray[np.int64], keyframes: Floats, T_bim_map: Floats | None) -> Lines:
        """Seconds (N,) since the first scan, and metres (N,) of each scan when it came and of the way as it is known
        now: keyframes (K, 4, 4) T_map_sensor. Not a number where the truth does not tell."""
        count = len(self._stamps)  # the run may go on meanwhile
        stamps, poses = np.array(self._stamps[:count], dtype=np.int64), np.array(self._poses[:count])
        ours, true = associate(stamps, self._truth.stamps_ns)
        if not len(ours):
            return np.empty(0), {}
        start = self._truth.poses[true[0]] @ inverse(poses[ours[0]])
        T = np.array([start if place is None else place for place in self._places[:count]])
        places = (T @ poses[:, :, 3, None])[:, :3, 0]
        came = np.full(count, np.nan)
        came[ours] = np.linalg.norm(places[ours] - self._truth.positions[true], axis=1)
        seconds = (stamps - stamps[0]) / 1e9
        known = self._of_keyframes(keyframes_ns, keyframes, start if T_bim_map is None else T_bim_map)
        told = np.isfinite(known)
        if not told.any():
            return seconds, {CAME: came}
        at = (keyframes_ns[told] - stamps[0]) / 1e9
        return seconds, {CAME: came, KNOWN: np.interp(seconds, at, known[told])}

    def _of_keyframes(self, stamps: NDArray[np.int64], poses: Floats, T_bim_map: Floats) -> Floats:
        errors = np.full(len(stamps), np.nan)
        ours, true = associate(stamps, self._truth.stamps_ns)
        places = (T_bim_map @ poses[ours][:, :, 3, None])[:, :3, 0]
        errors[ours] = np.linalg.norm(places - self._truth.positions[true], axis=1)
        return errors


def rms(errors: Floats) -> float:
    """The root of the mean square of what is known; not a number where nothing is."""
    known = errors[np.isfinite(errors)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")
