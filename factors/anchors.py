"""Anchors of a whole match: factors that tie the planes of your own graph to the planned walls of their match."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import gtsam
import numpy as np
from numpy.typing import ArrayLike, NDArray

from factors.bim import anchor_plane, frame_at
from factors.match_checks import check_directions, check_near, check_sides, name_of, planned_wall, unique_place
from factors.noise import noise_of_plane, noise_of_pose
from factors.planes import plane_from_wall
from factors.protocols import Match, Plan

Floats = NDArray[np.float64]
_TIE = 1e-4  # rad, m: of a wall's frame to the BIM frame; far below what walls are built to


class PlaneKeys(NamedTuple):
    """GTSAM keys of one wall: its `plane` variable, the pose `anchor` in whose frame the plane is, and a new variable
    `frame`, the pose of a frame of the BIM near the wall."""

    plane: int
    anchor: int
    frame: int


@dataclass(frozen=True, eq=False)
class Anchors:
    """Factors and start values for your own graph.

    Attributes:
        walls: For each matched wall, by its id in the map, the two factors (frame, anchor) of `frame_at` and
            `anchor_plane`. To release a wall, remove both.
        prior: The loose prior of the BIM frame (1 rad, 10 m), which walls leave free in height; None if it was in the
            values already.
        start: Start values of the new variables: the frames, and the BIM frame if it was not in the values.
        T_map_bim: (4, 4) the BIM frame of these start values; its origin is `origin`.
    """

    walls: Mapping[str, tuple[gtsam.NoiseModelFactor, gtsam.NoiseModelFactor]]
    prior: gtsam.NoiseModelFactor | None
    start: gtsam.Values
    T_map_bim: Floats

    def graph(self) -> gtsam.NonlinearFactorGraph:
        """Returns all factors: the prior if there is one, then frame and anchor of each wall in the order of
        `walls`."""
        graph = gtsam.NonlinearFactorGraph()
        if self.prior is not None:
            graph.add(self.prior)
        for frame, anchor in self.walls.values():
            graph.add(frame)
            graph.add(anchor)
        return graph


def anchors_of(
    match: Match, plan: Plan, keys: Mapping[str, PlaneKeys], values: gtsam.Values, bim: int, *, height: float = 0.0,
    origin: ArrayLike = (0.0, 0.0, 0.0), noise: gtsam.noiseModel.Base | None = None,
) -> Anchors:  # fmt: skip
    """Returns the factors that anchor your graph's planes to the planned walls with which a matcher paired them.

    Args:
        match: The answer for the map in the frame of `values`; remove wall surfaces that you want to leave out.
        plan: The plan that the map was matched with.
        keys: The keys of each matched wall surface, by its id in the map. It may hold other surfaces too.
        values: The current values of your graph: the planes (`OrientedPlane3`, in the frame of their anchor), the
            anchors (`Pose3`, T_map_anchor), and `bim` if it is in the graph already.
        bim: Key of the BIM pose, T_map_bim.
        height: z of the map's origin in the BIM frame, in metres. Walls do not determine it: add `storey_plane` for
            an observed floor, otherwise it keeps this value.
        origin: (3,) the origin of the frame of `bim`, in BIM coordinates. If the site's coordinates are large, choose
            a point in the building, the same in every call; T_bim_pose is then a shift by `origin`, times the inverse
            of `bim`'s pose, times the pose.
        noise: Three-dimensional noise of a wall as built relative to the plan; None for 0.01 rad, 0.02 m and a Huber
            loss at 1.345. If walls may be absent or moved, a second optimisation with `redescending_noise_of_plane`
            removes their influence on the others.

    With iSAM2, use `setFactorization("QR")`: its Cholesky fails if the height is known much worse than x and y.

    Each wall is anchored through a frame near it (see `anchor_plane`). Several surfaces of the map may be matched with
    one planned wall, and several may be parts of one plane variable; each needs its own frame.

    Raises:
        ValueError: In one line: the match is not unique or pairs no wall surface; keys or values of a matched surface
            are missing; a frame's key is in use; the plan has no such surface, its centroid or normal is not (x, y), or
            it is over 300 m from the origin; a wall faces away from the planned one or crosses it (over 60 degrees);
            all walls are parallel while the BIM frame is new; `origin` or `height` is not finite.
    """
    (yaw, x, y), shift = unique_place(match), np.asarray(origin, dtype=float)
    if shift.shape != (3,) or not np.all(np.isfinite([*shift, height])):
        raise ValueError(f"origin must be three finite numbers and height one, not {shift} and {height}")
    T_matched = gtsam.Pose3(gtsam.Rot3.Yaw(yaw), np.array([x, y, height]) - shift).inverse()
    is_new = not values.exists(bim)
    T_map_bim = T_matched if is_new else values.atPose3(bim)
    noise = noise_of_plane(0.01, 0.02, 1.345) if noise is None else noise
    start, walls, normals = gtsam.Values(), {}, []
    for s_id, a_id, _ in match.wall_surfaces:
        own, (centroid, normal) = _keys_of(s_id, keys, values), planned_wall(a_id, plan)
        check_sides(s_id, a_id, T_matched.rotation().unrotate(_normal_in_map(own, values)), normal)
        if values.exists(own.frame) or start.exists(own.frame):
            raise ValueError(f"the frame's key {name_of(own.frame)} of wall surface '{s_id}' is in use already")
        place = np.array([*centroid, height]) - shift
        check_near(a_id, place, place + shift)
        start.insert(own.frame, T_map_bim.compose(gtsam.Pose3(gtsam.Rot3(), place)))
        near = plane_from_wall(normal, (0.0, 0.0))  # the wall goes through the origin of its frame
        walls[s_id] = frame_at(place, bim, own.frame, _TIE), anchor_plane(near, own.frame, own.anchor, own.plane, noise)
        normals.append(normal)
    prior = None
    if is_new:
        check_directions(normals)
        start.insert(bim, T_map_bim)
        prior = gtsam.PriorFactorPose3(bim, T_map_bim, noise_of_pose(1.0, 10.0))
    return Anchors(walls, prior, start, np.asarray(T_map_bim.matrix()))


def _keys_of(s_id: str, keys: Mapping[str, PlaneKeys], values: gtsam.Values) -> PlaneKeys:
    if s_id not in keys:
        raise ValueError(f"no keys are given for the matched wall surface '{s_id}'")
    own = PlaneKeys(*keys[s_id])
    for what, key in (("plane", own.plane), ("anchor", own.anchor)):
        if not values.exists(key):
            raise ValueError(f"the values have no {what} {name_of(key)} of wall surface '{s_id}'")
    return own


def _normal_in_map(own: PlaneKeys, values: gtsam.Values) -> Floats:
    normal = values.atOrientedPlane3(own.plane).planeCoefficients().ravel()[:3]
    return np.asarray(values.atPose3(own.anchor).rotation().rotate(normal))
