"""Factor graphs in `.g2o` files: those of S-Graphs with planes and rooms, and poses with the covariances of the motions
between them."""

import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.common.files import text_lines
from data.geometry.poses import xyzquat_to_poses
from data.scene_graph.graph import SceneGraph
from data.scene_graph.nodes import Room, WallSurface, xy_of
from data.trajectory.readers import PoseList

_CROSSING = 0.5  # sine of the angle at which one wall of a room bounds another
_FIELDS = {  # tag -> (ids, numbers that are read); what follows them on a line has no meaning here
    "VERTEX_SE3:QUAT": (1, 7), "VERTEX_PLANE": (1, 4), "VERTEX_ROOM": (1, 3),
    "EDGE_SE3:QUAT": (2, 28), "EDGE_SE3_PLANE": (2, 10), "EDGE_2PLANES": (2, 0),
    "EDGE_ROOM_4PLANES": (5, 0),  # its measurement is never set: a room is where its planes are
}  # fmt: skip
_POSE, _PLANE, _ROOM = "VERTEX_SE3:QUAT", "VERTEX_PLANE", "VERTEX_ROOM"
_JOINS = {
    "EDGE_SE3:QUAT": (_POSE, _POSE),
    "EDGE_SE3_PLANE": (_POSE, _PLANE),
    "EDGE_2PLANES": (_PLANE, _PLANE),
    "EDGE_ROOM_4PLANES": (_ROOM, _PLANE, _PLANE, _PLANE, _PLANE),
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
    """A plane (nx, ny, nz, d), n.x + d = 0, in a keyframe's frame; `information` (3, 3) of azimuth, elevation (rad) and
    d (m)."""

    keyframe: int
    plane: int
    plane_in_sensor: Floats
    information: Floats


@dataclass(frozen=True, eq=False)
class PlaneGraph:
    """Keyframes as T_map_sensor (4, 4), planes (4,) and room centres (3,) in the map frame, by their ids in the file.

    `walls` are the planes that bound each room, `same` pairs of planes of one wall. `refused` has a line for everything
    left out because its numbers were never set.
    """

    keyframes: dict[int, Floats]
    planes: dict[int, Floats]
    rooms: dict[int, Floats]
    walls: dict[int, tuple[int, ...]]
    steps: tuple[Step, ...]
    seen: tuple[PlaneSeen, ...]
    same: tuple[tuple[int, int], ...]
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
    path = Path(path)
    return _Reader(path, poses_only).read(text_lines(path, "a .g2o file"))


@dataclass(frozen=True, eq=False)
class _Row:
    line: int
    tag: str
    ids: tuple[int, ...]
    numbers: Floats


class _Reader:
    def __init__(self, path: Path, poses_only: bool) -> None:
        self._path, self._poses_only = path, poses_only
        self._refused: list[str] = []

    def read(self, lines: list[str]) -> PlaneGraph:
        """Returns the graph of a file's lines, without what is fixed or not set. Raises UserError, naming the line."""
        words = [(number, line.split()) for number, line in enumerate(lines, 1) if line.strip()]
        fixed = {self._id(number, name) for number, (tag, *names) in words if tag == "FIX" for name in names}
        tags = set(_FIELDS)
        if self._poses_only:
            fixed, tags = set(), {"VERTEX_SE3:QUAT", "EDGE_SE3:QUAT"}
        rows = [self._row(number, tag, rest) for number, (tag, *rest) in words if tag in tags]
        rows = [row for row in rows if not fixed.intersection(row.ids) and self._is_set(row)]
        kinds: dict[int, str] = {}
        for row in rows:
            if row.tag.startswith("VERTEX"):
                if row.ids[0] in kinds:
                    raise self._bad(row.line, f"the id {row.ids[0]} is given twice")
                kinds[row.ids[0]] = row.tag
        for row in rows:
            self._check_edge(row, kinds)
        poses = {i: self._pose(number, v) for number, (i,), v in self._of(rows, "VERTEX_SE3:QUAT")}
        planes = {i: self._plane(number, v) for number, (i,), v in self._of(rows, "VERTEX_PLANE")}
        rooms = {i: v for _, (i,), v in self._of(rows, "VERTEX_ROOM")}
        for kind, found in (("keyframe", poses), ("plane", planes)):
            if not found and not (self._poses_only and kind == "plane"):
                raise UserError(f"{self._path}: no {kind} that is not fixed; a .g2o file of S-Graphs is needed")
        steps = [
            Step(i, j, self._pose(n, v[:7]), _symmetric(v[7:], 6)) for n, (i, j), v in self._of(rows, "EDGE_SE3:QUAT")
        ]
        seen = [
            PlaneSeen(i, j, self._plane(n, v[:4]), _symmetric(v[4:], 3))
            for n, (i, j), v in self._of(rows, "EDGE_SE3_PLANE")
        ]
        walls = {ids[0]: ids[1:] for _, ids, _ in self._of(rows, "EDGE_ROOM_4PLANES")}
        same = [(i, j) for _, (i, j), _ in self._of(rows, "EDGE_2PLANES")]
        return PlaneGraph(poses, planes, rooms, walls, tuple(steps), tuple(seen), tuple(same), tuple(self._refused))

    @staticmethod
    def _of(rows: list[_Row], tag: str) -> Iterator[tuple[int, tuple[int, ...], Floats]]:
        return ((row.line, row.ids, row.numbers) for row in rows if row.tag == tag)

    def _row(self, line: int, tag: str, words: list[str]) -> _Row:
        """What is read of a line. Raises UserError where it breaks off."""
        ids, numbers = _FIELDS[tag]
        if len(words) < ids + numbers:
            raise self._bad(line, f"{tag} needs {ids + numbers} numbers and has {len(words)}")
        try:
            read = np.array([float(word) for word in words[ids : ids + numbers]])
        except ValueError:
            raise self._bad(line, f"{tag} has a word instead of a number") from None
        return _Row(line, tag, tuple(self._id(line, word) for word in words[:ids]), read)

    def _id(self, line: int, word: str) -> int:
        try:
            return int(word)
        except ValueError:
            raise self._bad(line, f"'{word}' is not an id") from None

    def _is_set(self, row: _Row) -> bool:
        """Whether all numbers of a row are set; otherwise an edge is refused. Raises UserError for a vertex."""
        unset = [x for x in row.numbers.tolist() if not math.isfinite(x) or 0 < abs(x) < sys.float_info.min]
        if not unset:
            return True
        message = f"{row.tag} of {' and '.join(map(str, row.ids))} holds a number that was never set ({unset[0]:g})"
        if row.tag.startswith("VERTEX"):
            raise self._bad(row.line, message)
        self._refused.append(f"line {row.line}: {message}")
        return False

    def _check_edge(self, row: _Row, kinds: dict[int, str]) -> None:
        wanted = _JOINS.get(row.tag, ())
        for i, kind in zip(row.ids, wanted, strict=False):
            if kinds.get(i) != kind:
                raise self._bad(row.line, f"{row.tag} names {i}, which is not a {kind}")

    def _pose(self, line: int, xyzquat: Floats) -> Floats:
        if abs(np.linalg.norm(xyzquat[3:]) - 1) > _UNIT:
            raise self._bad(line, "a rotation is not a unit quaternion")
        return xyzquat_to_poses(xyzquat)

    def _plane(self, line: int, plane: Floats) -> Floats:
        size = float(np.linalg.norm(plane[:3]))
        if abs(size - 1) > _UNIT:
            raise self._bad(line, "a plane's normal is not a unit vector")
        return plane / size

    def _bad(self, line: int, what: str) -> UserError:
        return UserError(f"{self._path}, line {line}: {what}")


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
