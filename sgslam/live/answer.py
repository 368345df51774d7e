"""The answer to a scan, and how long answers took."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.geometry.poses import poses_to_xyzquat
from sgslam.cli.processes.mapping_process import HeldAnchor
from sgslam.types import Health

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Answer:
    """What is known right after a scan at `stamp_ns`.

    `T_odom_sensor` (4, 4), metres, is the tracker's pose. It never jumps, except in the first seconds: until the
    vertical is known, `health` is None and the pose is provisional. `health` is good, degraded or lost; a lost pose is
    a prediction, or, in the first seconds after a loss, in doubt. If the sensor was carried elsewhere while it was
    lost, `odom` and `map` restart, and `part` increases by one.

    `T_map_odom` (4, 4) is the correction by the map, the plan and loops. It may jump. `T_bim_map` (4, 4) is the pose of
    the map in the BIM frame, `T_bim_sensor` (4, 4) that of the sensor; None while the map is not anchored. `anchors`
    are those that hold. All these belong to the map as it was at `map_stamp_ns`, the stamp of the newest scan in it,
    None before the first.

    `keyframes` is the number of keyframes in the map. `waiting` is the number of scans that are tracked and wait for
    the map, this one included. `seconds` is the time from the call to the answer. `place` is the probability of the
    map's best place in the plan when it was last matched, and that of the runner-up.
    """

    stamp_ns: int
    T_odom_sensor: Floats
    T_map_odom: Floats
    T_bim_map: Floats | None
    health: Health | None
    anchors: tuple[HeldAnchor, ...]
    map_stamp_ns: int | None
    part: int
    keyframes: int
    waiting: int
    seconds: float
    place: tuple[float, float] = (0.0, 0.0)

    @property
    def T_map_sensor(self) -> Floats:  # noqa: N802
        """(4, 4) the sensor's pose in the map."""
        return np.asarray(self.T_map_odom @ self.T_odom_sensor)

    @property
    def T_bim_sensor(self) -> Floats | None:  # noqa: N802
        """(4, 4) the sensor's pose in the BIM frame; None while the map is not anchored."""
        return None if self.T_bim_map is None else np.asarray(self.T_bim_map @ self.T_map_sensor)

    @property
    def anchored(self) -> bool:
        """Whether the map is anchored to the building."""
        return self.T_bim_map is not None

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, without the list of anchors; poses as x, y, z, qx, qy, qz, qw."""
        states = [anchor.state for anchor in self.anchors]
        return {
            "stamp_ns": self.stamp_ns, "health": self.health, "anchored": self.anchored,
            "T_odom_sensor": _pose(self.T_odom_sensor), "T_map_odom": _pose(self.T_map_odom),
            "T_bim_sensor": _pose(self.T_bim_sensor), "tight": states.count("tight"), "loose": states.count("loose"),
            "keyframes": self.keyframes, "part": self.part, "waiting": self.waiting, "map_stamp_ns": self.map_stamp_ns,
            "place_probability": round(self.place[0], 5), "runner_up": round(self.place[1], 5),
            "seconds": round(self.seconds, 4),
        }  # fmt: skip


def _pose(T: Floats | None) -> list[float] | None:
    return None if T is None else [round(float(value), 6) for value in poses_to_xyzquat(T[None])[0]]


class Latencies:
    """How long answers took, and the most scans that ever waited."""

    def __init__(self) -> None:
        self._seconds: list[float] = []
        self._most_waiting = 0

    def add(self, seconds: float, waiting: int) -> None:
        """Adds an answer."""
        self._seconds.append(seconds)
        self._most_waiting = max(self._most_waiting, waiting)

    @property
    def answers(self) -> int:
        """How many there were."""
        return len(self._seconds)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for metrics.json; the percentiles are None before the first answer."""
        told: dict[str, Any] = {"answers": self.answers, "p50_ms": None, "p99_ms": None, "longest_ms": 0}
        if self._seconds:
            shares = np.quantile(self._seconds, (0.5, 0.99, 1.0), method="inverted_cdf")
            told |= zip(("p50_ms", "p99_ms", "longest_ms"), np.rint(1000 * shares).astype(int).tolist(), strict=True)
        return told | {"most_waiting": self._most_waiting}
