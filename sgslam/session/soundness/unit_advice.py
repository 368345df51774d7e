"""Tells scans in feet by the storeys that they show: floors and ceilings are too far apart, and from the sensor."""

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from data.trajectory import Trajectory
from sgslam.mapping import Floors

Floats = NDArray[np.float64]
_FOOT = 0.3048  # m
_STOREY = 6.5, 14.0  # m, height of one of 2 to 4.3 m if its feet are taken for metres
_CARRIED = 2.2  # m above the floor: more than a robot, a hand or a pole has; in feet it is 0.7 m
_QUICK = 1.5  # m/s, more than a carrier does that is not in a hurry; in feet it is 0.5 m/s
_ADVICE = "the scans seem to be in feet; multiply them by 0.3048"
_ALIKE = 0.15  # share by which the heights of a storey in the map and in the plan may differ


def feet_advice(floors: Floors, trajectory: Trajectory, plan: SceneGraph | None) -> str | None:
    """A line where the scans seem to be in feet: by the heights of the mapped floors (m), and by those of the planned
    walls, or where there are none by the speed of the sensor along its `trajectory` in the map."""
    storey, sensor = _heights(floors)
    if not _STOREY[0] < storey < _STOREY[1] or sensor < _CARRIED:
        return None
    seen = f"ceilings are {storey:.1f} m above the floor, and the sensor is {sensor:.1f} m"
    planned = _planned_heights(plan)
    if len(planned):
        usual = float(np.median(planned))
        if np.any(np.abs(planned / storey - 1) < _ALIKE) or abs(usual / (storey * _FOOT) - 1) > _ALIKE:
            return None
        return f"{seen}, where the plan's walls are {usual:.1f} m high: {_ADVICE}"
    speed = _speed(trajectory)
    if speed < _QUICK:
        return None
    return f"{seen}, at {speed:.1f} m/s: unless this is a hall, {_ADVICE}"


def _heights(floors: Floors) -> tuple[float, float]:
    """The heights (m) above the floor that a fifth of the ceilings by their area exceed, and of the sensor; 0 where
    there are none. The undersides of lintels and stairs are lower."""
    ceilings, area, sensor = [np.empty(0)], [np.empty(0)], [np.empty(0)]
    for floor in floors.maps:
        if floor.plane_in_map is not None:
            levels = floor.levels.levels(floor.walls.T_level_map)  # above the floor
            ceilings.append(levels.height[~levels.is_floor])
            area.append(levels.area[~levels.is_floor])
            sensor.append(np.full(len(ceilings[-1]), floor.sensor_height))
    weights = np.concatenate(area)
    return _quantile(np.concatenate(ceilings), weights), _quantile(np.concatenate(sensor), weights)


def _quantile(values: Floats, weights: Floats) -> float:
    if not len(values):
        return 0.0
    order = np.argsort(values)
    share = np.cumsum(weights[order]) / weights.sum()
    return float(values[order][np.searchsorted(share, 0.8)])


def _planned_heights(plan: SceneGraph | None) -> Floats:
    """(N,) m, of the plan's wall surfaces."""
    surfaces = () if plan is None else plan.wall_surfaces
    return np.array([s.height[1] - s.height[0] for s in surfaces if s.height is not None])


def _speed(trajectory: Trajectory) -> float:
    """m/s, exceeded in a quarter of the time; over seconds, since a carrier sways."""
    seconds = (trajectory.stamps_ns - trajectory.stamps_ns[0]) / 1e9
    rows = np.unique(np.searchsorted(seconds, np.arange(0.0, seconds[-1] + 1e-9)))
    if len(rows) < 2:
        return 0.0
    steps = np.linalg.norm(np.diff(trajectory.positions[rows], axis=0), axis=1) / np.diff(seconds[rows])
    return float(np.percentile(steps, 75))
