"""The paths of the plan, in pieces, and the band of the trajectory's uncertainty."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.trajectory import Trajectory
from sgslam.geometry.frames import transform_points
from sgslam.report.contents import ReportData

Array = NDArray[np.float64]
MAX_VERTICES = 3000  # of a drawn trajectory; more than a screen resolves
_KNOWN, _LOST = 0, 1  # states of a scan; larger ones are parts that were not placed


@dataclass(frozen=True)
class Mark:
    """A line through `points`, or (`closed`) the area within them, in the plan's frame: (N, 2).

    `title` is the tooltip, `looks` are the style classes within its layer, `element` is the GlobalId of what it stands
    for.
    """

    points: Array
    title: str = ""
    closed: bool = False
    looks: tuple[str, ...] = ()
    element: str = ""


def drawn_paths(data: ReportData, T_plan_map: Array) -> dict[str, list[Mark]]:
    """The pieces of each path, from bottom to top; `lost` are those of scans whose pose is predicted. A part of the map
    that was not placed is not drawn."""
    paths: dict[str, list[Mark]] = {"odometry": [], "trajectory": [], "lost": [], "truth": []}
    if data.truth is not None and data.a_graph is not None:
        paths["truth"] = _whole(data.truth, np.eye(4))
    if not len(data.trajectory_map):
        return paths
    if len(data.trajectory_odometry):
        # both first poses coincide, so that the drift from there on shows
        T_map_odom = data.trajectory_map.poses[0] @ np.linalg.inv(data.trajectory_odometry.poses[0])
        paths["odometry"] = _whole(data.trajectory_odometry, T_plan_map @ T_map_odom)
    if data.scans is None:
        paths["trajectory"] = _whole(data.trajectory_map, T_plan_map)
        return paths
    points, chosen, state = _vertices(data, T_plan_map)
    for start, end in _runs(state):
        if state[start] == _KNOWN:
            paths["trajectory"].append(Mark(_line(points[start:end])))
        elif state[start] == _LOST:  # from the known pose before to the one after
            around = np.arange(max(start - 1, 0), min(end + 1, len(state)))
            piece = points[around[state[around] <= _LOST]]
            seconds = data.scans.seconds
            first, last = seconds[chosen[start]], seconds[(*chosen, len(seconds))[end] - 1]
            title = f"lost: {first:.1f} to {last:.1f} s after the first scan"
            paths["lost"].append(Mark(_line(piece), title))
    return paths


def uncertainty_band(data: ReportData, T_plan_map: Array) -> list[Mark]:
    """Where the known part of an anchored trajectory lies with 95 %.

    It is swept by the ellipses of the positions' standard deviations along x and y, and so reaches twice the standard
    deviation to either side of the way.
    """
    import shapely

    if data.T_bim_map is None or data.scans is None or not len(data.trajectory_map):
        return []
    points, chosen, state = _vertices(data, T_plan_map)
    sigma = np.fmax.reduceat(data.scans.sigma[:, :2], chosen)
    state = np.where(np.isfinite(sigma).all(axis=1), state, _LOST)
    angles = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)  # which is too narrow by less than 1 %
    ellipses = points[:, None] + 2.0 * sigma[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    swept: list[Any] = []
    for start, end in _runs(state):
        if state[start] == _KNOWN:
            own = _line(ellipses[start:end])
            pairs = np.concatenate([own[:-1], own[1:]], axis=1)
            swept.extend(shapely.convex_hull(shapely.multipoints(pairs)))
    areas = [area for area in shapely.get_parts(shapely.union_all(swept).simplify(0.001)) if area.area]
    return [Mark(_with_holes(shapely.geometry.polygon.orient(area)), closed=True) for area in areas]


def _with_holes(area: Any) -> Array:
    """(K, 2) one outline around an area and back around each of its holes, by ways that cancel."""
    begin = np.array(area.exterior.coords)
    return np.vstack([begin, *(piece for hole in area.interiors for piece in (np.array(hole.coords), begin[:1]))])


def subsample(count: int, most: int = MAX_VERTICES) -> NDArray[np.intp]:
    """Indices of at most `most` of `count` items, evenly spaced, including the first and the last."""
    return np.linspace(0, count - 1, min(count, most)).round().astype(np.intp)


def _whole(trajectory: Trajectory, T_plan: Array) -> list[Mark]:
    chosen = subsample(len(trajectory))
    return [Mark(_line(transform_points(T_plan, trajectory.positions[chosen])[:, :2]))] if len(chosen) else []


def _vertices(data: ReportData, T_plan_map: Array) -> tuple[Array, NDArray[np.intp], NDArray[np.int64]]:
    """The drawn positions (N, 2) of the map's trajectory, their scans (N,), and their states (N,).

    A vertex stands for the scans up to the next one: where the place of any of them is not known, its own is not.
    """
    assert data.scans is not None
    chosen = subsample(len(data.trajectory_map))
    state = np.where(data.scans.part > 0, data.scans.part + _LOST, np.where(data.scans.lost, _LOST, _KNOWN))
    points = transform_points(T_plan_map, data.trajectory_map.positions[chosen])[:, :2]
    return points, chosen, np.maximum.reduceat(state, chosen)


def _runs(state: NDArray[np.int64]) -> Iterator[tuple[int, int]]:
    """Start and end of each stretch of equal states."""
    cuts = np.flatnonzero(np.diff(state)) + 1
    return zip([0, *cuts.tolist()], [*cuts.tolist(), len(state)], strict=True)


def _line(points: Array) -> Array:
    """At least two points: a lone one is drawn as a dot."""
    return np.repeat(points, 2, axis=0) if len(points) == 1 else points
