"""Factor graphs in `.g2o` files: those of S-Graphs with planes and rooms, and poses with the covariances of the motions
between them."""

import sys
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.common.files import parsed_lines
from data.geometry.poses import xyzquat_to_poses
from data.scene_graph.graph import SceneGraph
from data.scene_graph.nodes import Room, WallSurface, xy_of
from data.trajectory.trajectory import PoseList

_CROSSING = 0.5  # sine of the angle at which one wall of a room bounds another
_POSE, _PLANE, _ROOM = "VERTEX_SE3:QUAT", "VERTEX_PLANE", "VERTEX_ROOM"
_STEP, _SEEN, _WALLS = "EDGE_SE3:QUAT", "EDGE_SE3_PLANE", "EDGE_ROOM_4PLANES"
_FIELDS: dict[str, tuple[tuple[str, ...], int]] = {  # what the ids are, and how many numbers are read after them
    _POSE: ((_POSE,), 7),
    _PLANE: ((_PLANE,), 4),
    _ROOM: ((_ROOM,), 3),
    _STEP: ((_POSE, _POSE), 28),
    _SEEN: ((_POSE, _PLANE), 4),
    _WALLS: ((_ROOM, _PLANE, _PLANE, _PLANE, _PLANE), 0),  # its measurement is never set
}
_UNIT = 1e-3  # by which a unit vector may be off: files are written with six digits
Floats = NDArray[np.float64]
_ORDER = [3, 4, 5, 0, 1, 2]  # rotation first
_VECTOR_OF_ANGLE = np.diag([0.5, 0.5, 0.5, 1.0, 1.0, 1.0])  # a quaternion's vector part is half an angle


@dataclass(frozen=True, eq=False)
class Step:
    """The motion between two keyframes; `information` (6, 6) as in g2o: translation (m), then the vector part of the
    unit quaternion (half an angle)."""

    first: int
    second: int
    T_first_second: Floats
    information: Floats


@dataclass(frozen=True, eq=False)
class PlaneSeen:
    """A plane (nx, ny, nz, d), n.x + d = 0, in a keyframe's frame."""

    keyframe: int
    plane: int
    plane_in_sensor: Floats


@dataclass(frozen=True, eq=False)
class PlaneGraph:
    """Keyframes as T_map_sensor (4, 4), planes (4,) and room centres (3,) in the map frame, by their ids in the file.

    `walls` are the planes that bound each room. `refused` has a line for everything left out because its numbers were
    never set.
    """

    keyframes: dict[int, Floats]
    planes: dict[int, Floats]
    rooms: dict[int, Floats]
    walls: dict[int, tuple[int, ...]]
    steps: tuple[Step, ...]
    seen: tuple[PlaneSeen, ...]
    refused: tuple[str, ...]

    def scene_graph(self) -> SceneGraph:
        """Returns the S-graph in plan view: rooms `r<id>` and the walls that bound them, `w<plane>@r<room>`.

        A wall's length follows from the room's other walls. Walls that bound no room are left out, and rooms whose
        walls are not in the file, since the length of their walls is unknown.
        """
        rooms = {n: centre for n, centre in self.rooms.items() if n in self.walls}
        surfaces = [
            surface
            for n, centre in rooms.items()
            for plane in self.walls[n]
            if (surface := self._surface(n, centre[:2], plane)) is not None
        ]
        return SceneGraph("map", tuple(Room(f"r{n}", xy_of(c)) for n, c in rooms.items()), tuple(surfaces))

    def _surface(self, room: int, centre: Floats, plane: int) -> WallSurface | None:
        own = self.planes[plane] / np.linalg.norm(self.planes[plane][:2])
        own = own if own[:2] @ centre + own[3] > 0 else -own  # it is seen from within
        others = [self.planes[p] / np.linalg.norm(self.planes[p][:2]) for p in self.walls[room] if p != plane]
        crossing = [p for p in others if abs(own[0] * p[1] - own[1] * p[0]) > _CROSSING]
        corners = [np.linalg.solve([own[:2], p[:2]], [-own[3], -p[3]]) for p in crossing]
        tangent = np.array([own[1], -own[0]])
        along = np.array(corners) @ tangent if corners else np.empty(0)
        before, after = along[along < centre @ tangent], along[along > centre @ tangent]
        if not len(before) or not len(after):
            return None
        low, high = float(before.max()), float(after.min())
        middle = (low + high) / 2 * tangent - own[3] * own[:2]
        return WallSurface(f"w{plane}@r{room}", f"r{room}", xy_of(middle), xy_of(own), high - low)


def read_g2o(path: Path | str, poses_only: bool = False) -> PlaneGraph:
    """Reads all vertices and edges that are not fixed; those of other kinds are skipped.

    `poses_only`: keyframes and steps are read alone, the fixed ones too: a graph of poses is held at one of them.

    Raises UserError, naming the line, for a file that cannot be read, a line that breaks off or holds a word in place
    of a number, a vertex whose numbers were never set, an edge to nothing, and where no keyframe or no plane is left.
    """
    known = {_POSE, _STEP} if poses_only else set(_FIELDS)
    kinds, fixed, refused = dict[int, str](), set[int](), list[str]()
    rows: dict[str, list[tuple[tuple[int, ...], Floats]]] = defaultdict(list)

    def look(text: str) -> None:
        tag, *words = text.split()
        if tag == "FIX" and not poses_only:
            fixed.update(map(int, words))
        elif tag in known and tag.startswith("VERTEX"):
            if int(words[0]) in kinds:
                raise ValueError(f"the id {words[0]} is given twice")
            kinds[int(words[0])] = tag

    def keep(text: str) -> None:
        tag, *words = text.split()
        if tag not in known:
            return
        joined, size = _FIELDS[tag]
        if len(words) < len(joined) + size:
            raise ValueError(f"{tag} needs {len(joined) + size} numbers and has {len(words)}")
        ids = tuple(map(int, words[: len(joined)]))
        numbers = np.array(words[len(joined) : len(joined) + size], np.float64)
        if not fixed.isdisjoint(ids):
            return
        unset = numbers[~np.isfinite(numbers) | ((numbers != 0) & (np.abs(numbers) < sys.float_info.min))]
        if len(unset):
            message = f"{tag} of {' and '.join(map(str, ids))} holds a number that was never set ({unset[0]:g})"
            if tag.startswith("VERTEX"):
                raise ValueError(message)
            refused.append(message)
            return
        for i, kind in zip(ids, joined, strict=True):
            if kinds.get(i) != kind:
                raise ValueError(f"{tag} names {i}, which is not a {kind}")
        if tag in (_POSE, _STEP) and abs(np.linalg.norm(numbers[3:7]) - 1) > _UNIT:
            raise ValueError("a rotation is not a unit quaternion")
        if tag in (_PLANE, _SEEN):
            length = np.linalg.norm(numbers[:3])
            if abs(length - 1) > _UNIT:
                raise ValueError("a plane's normal is not a unit vector")
            numbers = numbers / length
        rows[tag].append((ids, numbers))

    for read in (look, keep):  # an edge may come before what it joins
        parsed_lines(path, "a .g2o file of S-Graphs", read)
    for kind, tag in (("keyframe", _POSE), ("plane", _PLANE)):
        if tag in known and tag not in rows:
            raise UserError(f"{path}: no {kind} that is not fixed; a .g2o file of S-Graphs is needed")
    return PlaneGraph(
        {i: xyzquat_to_poses(v) for (i,), v in rows[_POSE]},
        {i: v for (i,), v in rows[_PLANE]},
        {i: v for (i,), v in rows[_ROOM]},
        {ids[0]: ids[1:] for ids, _ in rows[_WALLS]},
        tuple(Step(i, j, xyzquat_to_poses(v[:7]), _symmetric(v[7:], 6)) for (i, j), v in rows[_STEP]),
        tuple(PlaneSeen(i, j, v) for (i, j), v in rows[_SEEN]),
        tuple(refused),
    )


def _symmetric(upper: Floats, size: int) -> Floats:
    """(size, size) from the rows of its upper triangle."""
    matrix = np.zeros((size, size))
    matrix[np.triu_indices(size)] = upper
    return matrix + np.triu(matrix, 1).T


def plane_of(surface: str) -> int:
    """The id of the plane that a wall surface of `PlaneGraph.scene_graph` is a part of."""
    return int(surface[1:].partition("@")[0])


def read_graph_poses(path: Path) -> PoseList:
    """The poses in the order of their ids, without stamps, with the covariances of the motions that the graph joins.

    The file's information matrices give the proportions of the covariances. Their common factor is estimated from what
    is left of the edges at the poses of the file (a posteriori variance of unit weight), where edges close loops;
    otherwise it is one. Where every matrix is the identity, they say nothing. Raises UserError for a file that is no
    graph of poses.
    """
    graph = read_g2o(path, poses_only=True)
    ids = sorted(graph.keyframes)
    before, factor = dict(zip(ids[1:], ids, strict=False)), _variance(graph)
    covariances: dict[int, Floats] = {}
    for step in graph.steps:
        low, high = sorted((step.first, step.second))
        information = _information(step)
        if before.get(high) != low or np.linalg.eigvalsh(information)[0] <= 0:
            continue
        own = factor * np.linalg.inv(information)  # in the axes of the second
        if step.second == low:
            turn = np.kron(np.eye(2), graph.keyframes[high][:3, :3].T @ graph.keyframes[low][:3, :3])
            own = turn @ own @ turn.T
        covariances[high] = (own + own.T) / 2
    if all(np.array_equal(step.information, np.eye(6)) for step in graph.steps):
        covariances = {}
    poses = np.stack([graph.keyframes[i] for i in ids])
    return PoseList(poses, None, [covariances.get(i) for i in ids])


def _information(step: Step) -> Floats:
    """(6, 6) of rotation (rad), then translation (m)."""
    return np.asarray(_VECTOR_OF_ANGLE @ step.information[np.ix_(_ORDER, _ORDER)] @ _VECTOR_OF_ANGLE)


def _variance(graph: PlaneGraph) -> float:
    """The variance of unit weight; 1 where nothing closes a loop."""
    from scipy.spatial.transform import Rotation  # here, because it takes a third of a second

    total, spare = 0.0, 6 * (len(graph.steps) - len(graph.keyframes) + 1)
    for step in graph.steps:
        found = np.linalg.inv(graph.keyframes[step.first]) @ graph.keyframes[step.second]
        error = np.linalg.inv(step.T_first_second) @ found
        residual = np.concatenate([Rotation.from_matrix(error[:3, :3]).as_rotvec(), error[:3, 3]])
        total += float(residual @ _information(step) @ residual)
    return total / spare if spare > 0 and total > 0 else 1.0
