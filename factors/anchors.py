"""Anchors of a whole match: factors that tie the planes of your own graph to the planned walls of their match."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import gtsam
import numpy as np
from numpy.typing import ArrayLike, NDArray

from factors.bim import anchor_plane, frame_at
from factors.noise import noise_of_plane, noise_of_pose
from factors.planes import plane_from_wall

Floats = NDArray[np.float64]
_TIE = 1e-4  # rad, m: of a wall's frame to the BIM frame; far below what walls are built to
_FARTHEST = 300.0  # m: with longer levers from the BIM frame to a wall the optimisation is poorly conditioned
_GATE = 0.5  # cosine of 60 degrees: beyond it the residual of a plane leads to the wrong side
_ACROSS = np.sin(np.radians(10))  # walls at a smaller angle let the BIM frame slide along them


class Match(Protocol):
    """Where a map lies in a plan; `matching.MatchResult` is one, or any class with these attributes."""

    @property
    def status(self) -> str:
        """`unique`, or something else where the place is not certain."""

    @property
    def reason(self) -> str:
        """The status explained in one line."""

    @property
    def T_a_s(self) -> tuple[float, float, float] | None:  # noqa: N802
        """(yaw, x, y) in rad and m, from the map to the BIM frame: p_bim = R(yaw) p_map + (x, y)."""

    @property
    def wall_surfaces(self) -> Sequence[tuple[str, str, float]]:
        """Matched wall surfaces as (id in the map, id in the plan, confidence)."""


class PlannedSurface(Protocol):
    """A wall surface of a plan, such as `data.WallSurface`."""

    @property
    def centroid(self) -> tuple[float, float]:
        """(x, y) of the footprint's mid point in the BIM frame, in metres."""

    @property
    def normal(self) -> tuple[float, float]:
        """(x, y) towards the side from which it is seen."""


class Plan(Protocol):
    """A plan, such as `data.SceneGraph`."""

    @property
    def surface_by_id(self) -> Mapping[str, PlannedSurface]:
        """Its wall surfaces by id."""


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
    match: Match,
    plan: Plan,
    keys: Mapping[str, PlaneKeys],
    values: gtsam.Values,
    bim: int,
    *,
    height: float = 0.0,
    origin: ArrayLike = (0.0, 0.0, 0.0),
    noise: gtsam.noiseModel.Base | None = None,
) -> Anchors:
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
    if match.status != "unique" or match.T_a_s is None:
        raise ValueError(f"the match is not unique but '{match.status}' ({match.reason}); anchor nothing to it")
    if not match.wall_surfaces:
        raise ValueError("the match pairs no wall surface; rooms alone anchor no plane")
    (yaw, x, y), shift = match.T_a_s, np.asarray(origin, dtype=float)
    if shift.shape != (3,) or not np.all(np.isfinite([*shift, height])):
        raise ValueError(f"origin must be three finite numbers and height one, not {shift} and {height}")
    T_matched = gtsam.Pose3(gtsam.Rot3.Yaw(yaw), np.array([x, y, height]) - shift).inverse()
    is_new = not values.exists(bim)
    T_map_bim = T_matched if is_new else values.atPose3(bim)
    noise = noise_of_plane(0.01, 0.02, 1.345) if noise is None else noise
    start, walls, normals = gtsam.Values(), {}, []
    for s_id, a_id, _ in match.wall_surfaces:
        own, (centroid, normal) = _keys_of(s_id, keys, values), _planned_wall(a_id, plan)
        in_anchor = values.atOrientedPlane3(own.plane).planeCoefficients().ravel()[:3]
        in_map = values.atPose3(own.anchor).rotation().rotate(in_anchor)
        _check_sides(s_id, a_id, float(T_matched.rotation().unrotate(in_map)[:2] @ normal))
        if values.exists(own.frame) or start.exists(own.frame):
            raise ValueError(f"the frame's key {_name_of(own.frame)} of wall surface '{s_id}' is in use already")
        place = np.array([*centroid, height]) - shift
        if (away := float(np.linalg.norm(place))) > _FARTHEST:
            near = tuple((place + shift).round().tolist())
            raise ValueError(f"the planned '{a_id}' is {away:.0f} m from the origin; give one near it, origin={near}")
        start.insert(own.frame, T_map_bim.compose(gtsam.Pose3(gtsam.Rot3(), place)))
        through = plane_from_wall(normal, (0.0, 0.0))  # the wall goes through the origin of its frame
        anchor = anchor_plane(through, own.frame, own.anchor, own.plane, noise)
        walls[s_id] = frame_at(place, bim, own.frame, _TIE), anchor
        normals.append(normal)
    prior = None
    if is_new:
        if np.abs(normals @ np.array([-normals[0][1], normals[0][0]])).max() < _ACROSS:
            raise ValueError("all matched walls are parallel; the BIM frame could slide along them; match one across")
        start.insert(bim, T_map_bim)
        prior = gtsam.PriorFactorPose3(bim, T_map_bim, noise_of_pose(1.0, 10.0))
    return Anchors(walls, prior, start, np.asarray(T_map_bim.matrix()))


def _keys_of(s_id: str, keys: Mapping[str, PlaneKeys], values: gtsam.Values) -> PlaneKeys:
    if s_id not in keys:
        raise ValueError(f"no keys are given for the matched wall surface '{s_id}'")
    own = PlaneKeys(*keys[s_id])
    for what, key in (("plane", own.plane), ("anchor", own.anchor)):
        if not values.exists(key):
            raise ValueError(f"the values have no {what} {_name_of(key)} of wall surface '{s_id}'")
    return own


def _planned_wall(a_id: str, plan: Plan) -> tuple[Floats, Floats]:
    """(2,) centroid and (2,) unit normal of a planned wall surface. Raises ValueError if it has none."""
    surface = plan.surface_by_id.get(a_id)
    if surface is None:
        raise ValueError(f"the plan has no wall surface '{a_id}'; it is not the plan that was matched")
    found = []
    for what, value in (("centroid", surface.centroid), ("normal", surface.normal)):
        point = np.asarray(value, dtype=float)
        if point.shape != (2,) or not np.all(np.isfinite(point)):
            raise ValueError(f"the {what} of the planned wall surface '{a_id}' is {point}; (x, y) is expected")
        found.append(point)
    return found[0], found[1] / np.linalg.norm(found[1])


def _check_sides(s_id: str, a_id: str, cosine: float) -> None:
    """Raises ValueError unless the normal as seen and the planned one, of which this is the cosine, are alike."""
    if cosine < -_GATE:
        raise ValueError(f"'{s_id}' faces away from the planned '{a_id}'; a normal points to the side that was seen")
    if cosine < _GATE:
        angle = np.degrees(np.arccos(cosine))
        raise ValueError(f"'{s_id}' is turned {angle:.0f} degrees from the planned '{a_id}'; are the keys its own?")


def _name_of(key: int) -> str:
    """A GTSAM key as words say it, for example x0."""
    return str(gtsam.DefaultKeyFormatter(key))
