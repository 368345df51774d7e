"""What the examples beside it take if they are given nothing: a walk through a generated flat, and the walls seen."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import gtsam
import numpy as np
import shapely
from numpy.typing import NDArray

from data import SceneGraph, WallSurface
from data.generation.buildings import generate_plan
from data.geometry.poses import poses_to_xyzquat
from data.scans.writers import write_ply
from factors import plane_from_wall

Array = NDArray[np.float64]
HEIGHT = 1.2  # m, of the sensor above the floor
SLIP = gtsam.Pose3(gtsam.Rot3.Yaw(0.01), np.array([0.05, 0.0, 0.0]))  # error of the odometry in each step of a metre


@dataclass(frozen=True, eq=False)
class Sighting:
    """A wall as one pose sees it: its plane (4,) with n.x + d = 0 and its mid point (3,), in the frame of the pose."""

    wall: str
    plane: Array
    middle: Array
    length: float


@dataclass(frozen=True, eq=False)
class Walk:
    """A walk: `truth` are the T_bim_pose, `steps` the odometry from each pose to the next, `seen` the walls by pose."""

    plan: SceneGraph
    truth: list[gtsam.Pose3]
    steps: list[gtsam.Pose3]
    seen: list[list[Sighting]]


def walk_through_a_flat(seed: int = 1, built_off: float = 0.0) -> Walk:
    """A walk from room to room, in steps of up to a metre. Walls have names of their own, in the order seen.

    One wall, `w5`, is built nearer to its room by `built_off` (m) than the plan says.
    """
    plan, rng = generate_plan("apartment", seed).graph, np.random.default_rng(seed)
    truth = list(_poses(plan))
    steps = [a.between(b).compose(SLIP) for a, b in itertools.pairwise(truth)]
    names: dict[str, str] = {}
    seen = []
    for pose in truth:
        at = shapely.Point(pose.x(), pose.y())
        rooms = {r.id for r in plan.rooms if shapely.Polygon(r.polygon).contains(at)}
        walls = [wall for wall in plan.wall_surfaces if wall.room in rooms]
        seen.append([_sighting(names.setdefault(w.id, f"w{len(names)}"), w, pose, rng, built_off) for w in walls])
    return Walk(plan, truth, steps, seen)


def _poses(plan: SceneGraph) -> Iterator[gtsam.Pose3]:
    left = [np.array(room.centroid) for room in plan.rooms]
    here = left.pop(0)
    while left:
        there = left.pop(int(np.argmin([np.linalg.norm(point - here) for point in left])))
        way = there - here
        for share in np.linspace(0, 1, int(np.ceil(np.linalg.norm(way))), endpoint=False):
            yaw, place = float(np.arctan2(way[1], way[0])), np.array([*(here + share * way), HEIGHT])
            yield gtsam.Pose3(gtsam.Rot3.Yaw(yaw), place)
        here = there


def _sighting(
    name: str, wall: WallSurface, pose: gtsam.Pose3, rng: np.random.Generator, built_off: float
) -> Sighting:  # fmt: skip
    centroid = np.array(wall.centroid) + (built_off if name == "w5" else 0.0) * np.array(wall.normal)
    plane = pose.matrix().T @ plane_from_wall(wall.normal, centroid)
    plane[3] += rng.normal(0, 0.01)
    middle = np.asarray(pose.transformTo(np.array([*centroid, HEIGHT])))
    return Sighting(name, plane, middle, float(wall.length or 0.0))


def write_local_maps(results: Path) -> tuple[SceneGraph, list[gtsam.Pose3]]:
    """Writes local maps as KISS-SLAM does, with a vertex every third pose; returns the plan and the true T_bim_vertex.

    As KISS-SLAM's, the last vertex has no cloud.
    """
    walk, rng = walk_through_a_flat(), np.random.default_rng(0)
    chosen = [i for i, seen in enumerate(walk.seen) if seen][::3]  # in a room, not within a wall
    poses = [gtsam.Pose3()]
    for step in walk.steps:
        poses.append(poses[-1].compose(step))
    lines = ["FIX 0"]
    (results / "local_maps/plys").mkdir(parents=True)
    for n, i in enumerate(chosen):
        lines.append(f"VERTEX_SE3:QUAT {n} {_words(poses[i])}")
        if n:
            measured = poses[chosen[n - 1]].between(poses[i])
            lines.append(f"EDGE_SE3:QUAT {n - 1} {n} {_words(measured)} 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1")
        if i != chosen[-1]:
            T_map_bim = poses[i].compose(walk.truth[i].inverse())
            cloud = T_map_bim.transformFrom(_cloud(walk.plan, walk.truth[i], rng).T).T
            write_ply(results / f"local_maps/plys/{n:06d}.ply", cloud)
    (results / "local_maps/local_map_graph.g2o").write_text("\n".join(lines) + "\n")
    return walk.plan, [walk.truth[i] for i in chosen]


def _words(pose: gtsam.Pose3) -> str:
    return " ".join(f"{value:.9f}" for value in poses_to_xyzquat(np.asarray(pose.matrix())))


def _cloud(plan: SceneGraph, pose: gtsam.Pose3, rng: np.random.Generator) -> Array:
    """(N, 3) points of all walls within 8 m, as of a map that was carried on: of the walls behind others too."""
    parts = []
    for wall in plan.wall_surfaces:
        left, right = np.array(wall.ends())
        along = np.linspace(left, right, int(np.ceil(20 * np.linalg.norm(right - left))))
        along = along[np.hypot(*(along - [pose.x(), pose.y()]).T) < 8.0]
        heights = np.arange(0.05, 2.6, 0.1)
        parts.append(np.column_stack([np.repeat(along, len(heights), axis=0), np.tile(heights, len(along))]))
    cloud = np.concatenate(parts)
    return cloud + rng.normal(0, 0.01, cloud.shape)


def wall_in_map(seen: Sighting, T_map_pose: gtsam.Pose3) -> WallSurface:
    """The wall in an S-graph: in the map frame, with the normal towards the side that was seen. It names no room."""
    x, y, _ = T_map_pose.transformFrom(seen.middle).tolist()
    nx, ny, _ = T_map_pose.rotation().rotate(seen.plane[:3]).tolist()
    return WallSurface(seen.wall, None, (x, y), (nx, ny), seen.length)


def error(poses: list[gtsam.Pose3], truth: list[gtsam.Pose3]) -> float:
    """Root mean square of the horizontal distances in metres between poses and their truth."""
    away = [np.hypot(a.x() - b.x(), a.y() - b.y()) for a, b in zip(poses, truth, strict=True)]
    return float(np.sqrt(np.mean(np.square(away))))
