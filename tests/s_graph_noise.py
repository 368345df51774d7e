"""S-graphs as a LiDAR would draw them: a connected part of an A-graph, seen badly, in a frame of its own.

The measures of noise are those that were fitted to real scans by the authors of the published matcher (ends
of walls, offsets, tilts, the shortest wall); what is missing, cut in pieces or no wall at all is ours.
"""

from dataclasses import dataclass, replace

import numpy as np
import shapely

from data import Room, SceneGraph, WallSurface
from data.geometry import se2


@dataclass(frozen=True)
class Noise:
    """Standard deviations (metres, radians) and shares."""

    end: float = 0.346
    offset: float = 0.061
    tilt: float = float(np.radians(0.15))
    shortest: float = 0.35
    missing: float = 0.1
    pieces: float = 0.1
    clutter: float = 0.1
    drift_yaw: float = 0.0  # for each step from room to room
    drift_xy: float = 0.0


REAL = Noise()
DRIFT = replace(REAL, drift_yaw=float(np.radians(1.5)), drift_xy=0.15)


@dataclass(frozen=True)
class Drawn:
    """An S-graph and the truth: S ids to A ids, and the best rigid T_a_s of the true matches."""

    s: SceneGraph
    rooms: dict[str, str]
    wall_surfaces: dict[str, str]
    T_a_s: np.ndarray
    floor: str | None


def draw(a: SceneGraph, rng: np.random.Generator, rooms: int, noise: Noise = REAL) -> Drawn:
    """Sees so many neighbouring rooms of an A-graph (of one storey) whose rooms have polygons."""
    seen, parent = _walk(a, rng, rooms)
    bent = _drift(a, seen, parent, rng, noise)
    T_map_a = np.array([rng.uniform(-np.pi, np.pi), *rng.uniform(-20, 20, 2)])
    s_rooms, s_walls, room_truth, wall_truth = [], [], {}, {}
    for r in rng.permutation(len(seen)):
        room = a.rooms[seen[r]]
        walls: list[tuple[WallSurface, str | None]] = []
        for wall in a.surfaces_of_room[room.id]:
            walls += [(w, wall.id) for w in _seen(wall, rng, noise)]
        walls += [(w, None) for w in _clutter(room, len(walls), rng, noise)]
        if not any(truth for _, truth in walls):
            continue
        name = f"R{len(s_rooms)}"
        first = len(s_walls)
        for k in rng.permutation(len(walls)):
            placed = _placed(walls[k][0], se2.compose(T_map_a, bent[r]))
            s_walls.append(replace(placed, id=f"W{len(s_walls)}", room=name, floor="map"))
            if walls[k][1] is not None:
                wall_truth[s_walls[-1].id] = walls[k][1]
        centroid = np.mean([w.centroid for w in s_walls[first:]], axis=0)
        s_rooms.append(Room(name, (float(centroid[0]), float(centroid[1])), "map"))
        room_truth[name] = room.id
    graph = SceneGraph("map", tuple(s_rooms), tuple(s_walls))
    T_a_s = _best_rigid(graph, a, wall_truth, se2.inverse(T_map_a))
    return Drawn(graph, room_truth, wall_truth, T_a_s, a.rooms[seen[0]].floor)


def _walk(a: SceneGraph, rng: np.random.Generator, count: int) -> tuple[list[int], list[int]]:
    shapes = [shapely.Polygon(r.polygon) for r in a.rooms]
    seen, parent = [int(rng.integers(len(shapes)))], [-1]
    while len(seen) < count:
        ways = [
            (k, n)
            for n, r in enumerate(seen)
            for k in range(len(shapes))
            if k not in seen and shapes[k].distance(shapes[r]) < 0.5
        ]
        if not ways:
            break
        k, n = ways[int(rng.integers(len(ways)))]
        seen.append(k)
        parent.append(n)
    return seen, parent


def _drift(
    a: SceneGraph, seen: list[int], parent: list[int], rng: np.random.Generator, noise: Noise
) -> list[np.ndarray]:
    """What each room's place has drifted by: (3,) motions in A's frame, about the room's centroid."""
    motions: list[np.ndarray] = []
    for r, p in zip(seen, parent, strict=True):
        if p < 0:
            motions.append(np.zeros(3))
            continue
        centre = np.array(a.rooms[r].centroid)
        yaw = rng.normal(0, noise.drift_yaw) if noise.drift_yaw else 0.0
        shift = rng.normal(0, noise.drift_xy, 2) if noise.drift_xy else np.zeros(2)
        step = np.array([yaw, *(centre - se2.rotate(yaw, centre) + shift)])
        motions.append(se2.compose(motions[p], step))
    return motions


def _seen(wall: WallSurface, rng: np.random.Generator, noise: Noise) -> list[WallSurface]:
    if rng.random() < noise.missing:
        return []
    length = wall.length or 0.0
    spans = [(-length / 2, length / 2)]
    if rng.random() < noise.pieces and length > 1.2:
        cut, gap = rng.uniform(-0.25, 0.25) * length, rng.uniform(0.1, 0.6)
        spans = [(-length / 2, cut - gap / 2), (cut + gap / 2, length / 2)]
    pieces = []
    for low, high in spans:
        low, high = low + rng.normal(0, noise.end), high + rng.normal(0, noise.end)
        if high - low < noise.shortest:
            continue
        pieces.append(_piece(wall, low, high, rng.normal(0, noise.offset), rng.normal(0, noise.tilt)))
    return pieces


def _piece(wall: WallSurface, low: float, high: float, offset: float, tilt: float) -> WallSurface:
    n = np.array(wall.normal)
    centre = np.array(wall.centroid) + (low + high) / 2 * np.array([-n[1], n[0]]) + offset * n
    turned = se2.rotate(tilt, n)
    return replace(
        wall, centroid=(float(centre[0]), float(centre[1])), normal=(float(turned[0]), float(turned[1])),
        length=float(high - low),
    )  # fmt: skip


def _clutter(room: Room, walls: int, rng: np.random.Generator, noise: Noise) -> list[WallSurface]:
    """Cupboards: surfaces within the room, along its walls' directions mostly."""
    polygon = shapely.Polygon(room.polygon)
    low_x, low_y, high_x, high_y = polygon.bounds
    found = []
    ring = np.array(room.polygon)
    along = np.arctan2(*(ring[1] - ring[0])[::-1])
    for _ in range(int(rng.binomial(max(walls, 1), noise.clutter))):
        for _ in range(20):
            x, y = rng.uniform(low_x, high_x), rng.uniform(low_y, high_y)
            if shapely.contains_xy(polygon, x, y):
                break
        angle = along + rng.integers(4) * np.pi / 2 if rng.random() < 0.8 else rng.uniform(-np.pi, np.pi)
        normal = (float(np.cos(angle)), float(np.sin(angle)))
        found.append(WallSurface("clutter", None, (float(x), float(y)), normal, float(rng.uniform(0.4, 1.8))))
    return found


def _placed(wall: WallSurface, T: np.ndarray) -> WallSurface:
    c = se2.apply(T, np.array(wall.centroid))
    n = se2.rotate(T[0], np.array(wall.normal))
    return replace(wall, centroid=(float(c[0]), float(c[1])), normal=(float(n[0]), float(n[1])))


def _best_rigid(s: SceneGraph, a: SceneGraph, truth: dict[str, str], start: np.ndarray) -> np.ndarray:
    """Least squares of true pairs: S mid points to A lines, and headings by the walls' ends."""
    T = start
    for _ in range(5):
        rows, values = [], []
        for i, j in truth.items():
            wall, plan = s.surface_by_id[i], a.surface_by_id[j]
            n = np.array(plan.normal)
            for end in wall.ends():
                p = se2.apply(T, np.array(end))
                arm = p - T[1:]
                rows.append([n[1] * arm[0] - n[0] * arm[1], n[0], n[1]])
                values.append(-n @ (p - np.array(plan.centroid)))
        damped = np.vstack((rows, 0.01 * np.eye(3)))
        step = np.linalg.lstsq(damped, np.append(values, [0, 0, 0]), rcond=None)[0]
        T = np.array([se2.wrap(T[:1] + step[0])[0], *(T[1:] + step[1:])])
    return T
