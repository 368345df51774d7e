"""Overlaps in plan between the wall surfaces of an S-graph and of an A-graph, under a known motion."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from data.common.errors import UserError
from data.geometry import se2
from data.geometry.se2 import fit_to_lines
from data.scene_graph.segments import Segments
from matching.arrays import arrays
from sgslam.geometry.frames import is_rigid
from sgslam.geometry.trajectory_errors import yaw_errors

Array = NDArray[np.float64]
# Limits for an S surface to lie on an A surface.
MOST_OFFSET_M = 0.3  # along the A surface's normal at the overlap
MOST_ANGLE_RAD = float(np.radians(10))  # between the normals
LEAST_OVERLAP_M = 0.1


@dataclass(frozen=True, eq=False)
class Surfaces(Segments):
    """Wall surfaces with their ids; all lengths are known."""

    ids: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Overlaps:
    """For all pairs of S and A surfaces, (S, A) arrays; the frame is the A-graph's.

    `low`, `high`: the overlap on the A surface, metres along its tangent from its middle; `length` its length, 0
    where the pair is outside the limits. `offset`: of the S surface along the A surface's normal, in the middle of
    the overlap. `angle`: from the A surface's normal to the S surface's.
    """

    s: Surfaces
    a: Surfaces
    low: Array
    high: Array
    length: Array
    offset: Array
    angle: Array


def plan_motion(T_bim_map: Array) -> Array:
    """(yaw, x, y) of a rigid motion (4, 4): its turn about z, whatever the tilt of the map, and its shift in plan.

    Raises UserError for a matrix that is not rigid or turns the map upside down.
    """
    if not is_rigid(T_bim_map):
        raise UserError("T_bim_map: not a rigid motion; give a 4 x 4 matrix")
    T = np.asarray(T_bim_map, dtype=float)
    if T[2, 2] < 0:
        raise UserError("T_bim_map: turns the map upside down; its plan is not that of the building")
    return np.array([yaw_errors(T[None], np.eye(4)[None])[0], T[0, 3], T[1, 3]])


def one_storey(a_graph: SceneGraph) -> SceneGraph:
    """Returns the graph. Raises UserError if it has several storeys, which would overlap in plan."""
    floors = {w.floor for w in a_graph.wall_surfaces} | {r.floor for r in a_graph.rooms}
    if len(floors) > 1:
        raise UserError(f"the plan has {len(floors)} storeys; give the one of the map: a_graph.on_floor(...)")
    return a_graph


def segments(graph: SceneGraph, T_out_graph: Array) -> Surfaces:
    """The graph's wall surfaces under a motion (yaw, x, y); unknown lengths are derived from the rooms' other walls."""
    if not graph.wall_surfaces:
        return Surfaces(np.empty((0, 2)), np.empty(0), np.empty(0), ())
    walls = arrays(graph, None, list(graph.wall_surfaces))
    T = se2.compose(T_out_graph, walls.T_graph_own)
    return Surfaces(se2.apply(T, walls.centre), se2.wrap(walls.heading + T[0]), walls.half, walls.ids)


def overlaps(s: Surfaces, a: Surfaces) -> Overlaps:
    """All pairs of surfaces, both in the A-graph's frame."""
    angle = se2.wrap(s.heading[:, None] - a.heading[None, :])
    facing = np.abs(angle) <= MOST_ANGLE_RAD
    cosine = np.where(facing, np.cos(angle), 1.0)
    apart = s.centre[:, None] - a.centre[None, :]
    along = np.einsum("ijk,jk->ij", apart, a.tangent)
    reach = s.half[:, None] * cosine
    low = np.maximum(along - reach, -a.half[None, :])
    high = np.minimum(along + reach, a.half[None, :])
    # The S surface's line leaves the A surface's by the tangent of the angle, seen along the A surface's tangent.
    slope = -np.where(facing, np.tan(angle), 0.0)
    offset = np.einsum("ijk,jk->ij", apart, a.normal) + ((low + high) / 2 - along) * slope
    least = np.minimum(LEAST_OVERLAP_M, np.minimum(2 * s.half[:, None], 2 * a.half[None, :]) / 2)
    on = facing & (np.abs(offset) <= MOST_OFFSET_M) & (high - low >= least)
    return Overlaps(s, a, low, high, np.where(on, high - low, 0.0), offset, angle)


def best_rigid_fit(s_graph: SceneGraph, a_graph: SceneGraph, wall_surfaces: Mapping[str, str]) -> Array:
    """(yaw, x, y) T_a_s that brings the S surfaces nearest to their A surfaces (S id to A id): least squares of the
    distances of the S surfaces' ends from the A surfaces' lines. The truth for a map that bends.

    Raises UserError for ids that are not in the graphs and where the A surfaces are parallel.
    """
    s, a = segments(s_graph, np.zeros(3)), segments(a_graph, np.zeros(3))
    s_at, a_at = ({key: k for k, key in enumerate(graph.ids)} for graph in (s, a))
    if unknown := [*(wall_surfaces.keys() - s_at.keys()), *(set(wall_surfaces.values()) - a_at.keys())]:
        raise UserError(f"true matches: no wall surface '{min(unknown)}' in the graph")
    i = np.array([s_at[key] for key in wall_surfaces], dtype=int)
    j = np.array([a_at[key] for key in wall_surfaces.values()], dtype=int)
    normal = a.normal[j]
    if len(j) < 3 or np.linalg.svd(normal, compute_uv=False)[-1] < np.sin(np.radians(10)):
        raise UserError(f"{len(j)} true matches whose walls are few or parallel: they do not place the map")
    turn = np.exp(1j * (a.heading[j] - s.heading[i])) @ s.half[i]
    reach = s.half[i, None] * s.tangent[i]
    ends, lines = np.concatenate([s.centre[i] + reach, s.centre[i] - reach]), np.concatenate([j, j])
    yaw = float(np.angle(turn))
    start = np.array([yaw, *(a.centre[j].mean(axis=0) - se2.rotate(yaw, s.centre[i].mean(axis=0)))])
    return fit_to_lines(ends, a.centre[lines], a.normal[lines], start)
