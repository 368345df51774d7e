"""Live use from Python: `LiveSlam`, and its answer to each scan."""

import atexit
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.geometry.poses import poses_to_xyzquat
from data.scans.scan import SkippedScan
from sgslam.cli.job.inputs import PassedScans, RunInputs
from sgslam.cli.options import MOST_WAITING, RunOptions, Triple
from sgslam.cli.processes.mapping_process import HeldAnchor, MappingProcess, MapState
from sgslam.cli.processes.tracking_side import TrackingSide
from sgslam.config import Config
from sgslam.types import Health, TrackedScan
from sgslam.warm_up import compile_ahead, warm_up

__all__ = ["Answer", "HeldAnchor", "LiveSlam"]
Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class Answer(MapState):
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
    the map, this one included. `seconds` is the time from the scan's arrival to the answer. `place` is the probability
    of the map's best place in the plan when it was last matched, and that of the runner-up.
    """

    stamp_ns: int
    T_odom_sensor: Floats
    health: Health | None
    waiting: int
    seconds: float

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
            "stamp_ns": self.stamp_ns,
            "health": self.health,
            "anchored": self.anchored,
            "T_odom_sensor": _pose(self.T_odom_sensor),
            "T_map_odom": _pose(self.T_map_odom),
            "T_bim_sensor": _pose(self.T_bim_sensor),
            "tight": states.count("tight"),
            "loose": states.count("loose"),
            "keyframes": self.keyframes,
            "part": self.part,
            "waiting": self.waiting,
            "map_stamp_ns": self.map_stamp_ns,
            "place_probability": round(self.place[0], 5),
            "runner_up": round(self.place[1], 5),
            "seconds": round(self.seconds, 4),
        }


def _pose(T: Floats | None) -> list[float] | None:
    return None if T is None else [round(float(value), 6) for value in poses_to_xyzquat(T[None])[0]]


def latencies(seconds: Sequence[float]) -> dict[str, Any]:
    """How long answers took, as in metrics.json; the percentiles are None before the first."""
    told: dict[str, Any] = {"answers": len(seconds), "p50_ms": None, "p99_ms": None, "longest_ms": 0}
    if seconds:
        shares = np.quantile(seconds, (0.5, 0.99, 1.0), method="inverted_cdf")
        told |= zip(("p50_ms", "p99_ms", "longest_ms"), np.rint(1000 * shares).astype(int).tolist(), strict=True)
    return told


class LiveSlam:
    """Tracks scans in this process, and builds and anchors the map in a second one, which takes the same scans in the
    same order, only later. The results are those of a run with one pass (`--single-pass`) on these scans.

    `out` is the folder for the results, `bim` the file of the building. `start` is a rough pose of the sensor in the
    BIM frame, if known: x, y (m) and yaw (rad). `map` is the folder of an earlier run, whose map this one extends. At
    most `most_waiting` scans wait for the map; then `add_scan` waits too, and nothing is dropped. `more` are other
    options of `sgslam live`.

    The second process imports the main program again: protect its code with `if __name__ == "__main__":`.
    """

    def __init__(
        self,
        out: Path | str,
        bim: Path | str | None = None,
        *,
        config: Config | None = None,
        storey: str | None = None,
        start: Triple | None = None,
        map: Path | str | None = None,
        most_waiting: int = MOST_WAITING,
        more: RunOptions | None = None,
    ) -> None:
        """Returns once both processes are ready; the first time after an installation, compilation takes a minute.
        Raises UserError for unusable input."""
        out, plan, prior = Path(out), Path(bim) if bim else None, Path(map) if map else None
        told: dict[str, Any] = {"out": out, "bim": plan, "map": prior, "storey": storey, "start": start}
        options = replace(more or RunOptions(), **told, single_pass=True, live=True)
        config = config or Config()
        compile_ahead().wait()
        self._seconds, self._most_waiting = list[float](), 0  # of the answers
        self._map = MappingProcess(most_waiting)
        try:
            self._map.begin(RunInputs(options, config, PassedScans(out)))
            warm_up(config, with_map=False)  # while that process reads the building
            self._map.wait_until_ready()
        except BaseException:
            self._map.kill()
            raise
        self._is_open = True
        atexit.register(self._map.end)  # without a call of finish the results are written all the same
        self._side = TrackingSide(config, self._map)

    def add_scan(
        self,
        stamp_ns: int,
        points: NDArray[np.floating[Any]],
        point_times: Floats | None = None,
        came_s: float | None = None,
    ) -> Answer:
        """Tracks a scan, given by its stamp in nanoseconds and its points (N, 3) in metres in the sensor frame.

        `point_times` (N,) are the seconds after the stamp at which the points were measured; without them the setting
        `tracking.point_times` counts. `came_s` is when the scan came, by `time.perf_counter`, where that was before the
        call. Raises UserError as `SceneGraphSlam.add_scan` does, and if the other process has
        ended.
        """
        began = perf_counter() if came_s is None else came_s
        T_odom_sensor, health = self._newest(self._side.add_scan(stamp_ns, points, point_times))
        known, part = self._map.state, self._side.tracking.part
        if known.part != part:  # that map is of the frame `odom` before
            known = MapState(part=part, map_stamp_ns=known.map_stamp_ns, keyframes=known.keyframes)
        answer = Answer(
            **vars(known),
            stamp_ns=int(stamp_ns),
            T_odom_sensor=T_odom_sensor,
            health=health,
            waiting=self._map.waiting,
            seconds=perf_counter() - began,
        )
        self._seconds.append(answer.seconds)
        self._most_waiting = max(self._most_waiting, answer.waiting)
        return answer

    def add_imu(self, stamp_ns: int | NDArray[np.int64], gyro: Floats, accel: Floats) -> None:
        """As `SceneGraphSlam.add_imu`, errors included: add the samples up to a scan's end before the scan."""
        self._side.add_imu(stamp_ns, gyro, accel)

    def set_start(self, x: float, y: float, yaw: float) -> None:
        """Gives a rough present pose of the sensor: x, y (m) and heading (rad) in the BIM frame.

        It decides between places that fit the map equally well. A map that is anchored already is not moved.
        """
        self._map.put("set_start", pose=(x, y, yaw))

    def finish(
        self,
        skipped: Sequence[SkippedScan] = (),
        remarks: Sequence[str] = (),
    ) -> dict[str, Any]:
        """Completes the map and writes the results to the folder, as a run does; returns the content of metrics.json.

        `skipped` and `remarks` are what the source reports about its scans. Waits for all scans. Raises UserError if no
        scan was added, or if the other process has ended.
        """
        self._is_open = False
        live = {"live": {**latencies(self._seconds), "most_waiting": self._most_waiting}}
        try:
            return self._side.finish(skipped=skipped, remarks=remarks, measured=live)
        finally:
            atexit.unregister(self._map.end)

    def __enter__(self) -> "LiveSlam":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Finishes, whatever happened, unless that is done."""
        if self._is_open:
            self.finish()

    @property
    def waiting(self) -> int:
        """The number of scans that are tracked and wait for the map."""
        return self._map.waiting

    def _newest(self, scans: list[TrackedScan]) -> tuple[Floats, Health | None]:
        """(4, 4) T_odom_sensor of the newest scan and its health, None while it waits."""
        waiting = self._side.tracking.waiting
        if waiting is not None:
            return waiting, None
        if (held := self._side.tracking.held) is not None:
            return held.T_odom_sensor, "lost"
        return scans[-1].T_odom_sensor, scans[-1].health
