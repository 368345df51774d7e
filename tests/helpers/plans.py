"""Small floor plans for tests: rooms as polygons, turned into A-graphs."""

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely

from data import Room, SceneGraph, WallSurface

Polygon = list[tuple[float, float]]
SHARED = Path(__file__).parents[3] / "shared"


def a_graph(polygons: Sequence[Polygon], floor: str | None = None, prefix: str = "") -> SceneGraph:
    """Rooms with a wall surface for every straight run of their outline."""
    rooms, surfaces = [], []
    for k, polygon in enumerate(polygons):
        shape = shapely.orient_polygons(shapely.Polygon(polygon))  # counter-clockwise: inside is on the left
        room = f"{prefix}room{k}"
        ring = tuple((float(x), float(y)) for x, y in shape.exterior.coords[:-1])
        rooms.append(Room(room, (shape.centroid.x, shape.centroid.y), floor, "", ring))
        for n, (p, q) in enumerate(_straight_runs(np.array(ring))):
            length = float(np.hypot(*(q - p)))
            x, y = ((q - p) / length).tolist()
            middle = (float(p[0] + q[0]) / 2, float(p[1] + q[1]) / 2)
            surfaces.append(WallSurface(f"{room}/{n}", room, middle, (-y, x), length, floor))
    return SceneGraph("bim", tuple(rooms), tuple(surfaces))


def _straight_runs(ring: np.ndarray, bend: float = np.radians(4)) -> list[tuple[np.ndarray, np.ndarray]]:
    step = np.roll(ring, -1, axis=0) - ring
    ring, step = ring[np.hypot(*step.T) > 1e-6], step[np.hypot(*step.T) > 1e-6]
    angle = np.arctan2(step[:, 1], step[:, 0])
    turn = (angle - np.roll(angle, 1) + np.pi) % (2 * np.pi) - np.pi
    corner = ring[np.abs(turn) > bend]
    runs = zip(corner, np.roll(corner, -1, axis=0), strict=True)
    return [(p, q) for p, q in runs if np.hypot(*(q - p)) > 0.05]


def merged(*graphs: SceneGraph) -> SceneGraph:
    """Several graphs as one; their ids must differ."""
    return SceneGraph(
        "bim", sum((g.rooms for g in graphs), ()), sum((g.wall_surfaces for g in graphs), ()),
        sum((g.doors for g in graphs), ()), sum((g.floors for g in graphs), ()),
    )  # fmt: skip


def box(x: float, y: float, width: float, depth: float) -> Polygon:
    """A rectangular room by its lower left corner."""
    return [(x, y), (x + width, y), (x + width, y + depth), (x, y + depth)]


def flat(rng: np.random.Generator, width: float = 22.0, depth: float = 14.0) -> list[Polygon]:
    """Rooms of uneven sizes: a rectangle cut again and again."""
    wall = 0.15

    def cut(x: float, y: float, w: float, d: float) -> list[Polygon]:
        if w * d < 14 or min(w, d) < 2.2 or (max(w, d) < 5 and rng.random() < 0.4):
            return [box(x + wall / 2, y + wall / 2, w - wall, d - wall)]
        share = float(rng.uniform(0.3, 0.7))
        if w > d:
            return cut(x, y, share * w, d) + cut(x + share * w, y, (1 - share) * w, d)
        return cut(x, y, w, share * d) + cut(x, y + share * d, w, (1 - share) * d)

    return cut(0.0, 0.0, width, depth)


def offices(widths_below: Sequence[float], widths_above: Sequence[float]) -> list[Polygon]:
    """Two rows of offices, 5 m deep, along a corridor 2 m wide."""
    wall = 0.12
    rooms: list[Polygon] = []
    for y, widths in ((0.0, widths_below), (7.0 + 2 * wall, widths_above)):
        x = 0.0
        for width in widths:
            rooms.append(box(x, y, width, 5.0))
            x += width + wall
    length = max(sum(w) + wall * (len(w) - 1) for w in (widths_below, widths_above))
    return [*rooms, box(0.0, 5.0 + wall, length, 2.0)]


def swiss(name: str, floor: str | None = None, prefix: str = "") -> SceneGraph:
    """A floor of the shared folder."""
    value = json.loads((SHARED / "data/floorplans/swiss_floors" / f"{name}.json").read_text())
    shapes = [shapely.Polygon(r["polygon"]["coordinates"][0]) for r in value["rooms"]]
    kept: list[shapely.Polygon] = []
    for shape in sorted(shapes, key=lambda p: -p.area):  # some rooms are drawn twice, some within another
        if all(shape.intersection(other).area < 0.3 * shape.area for other in kept):
            kept.append(shape)
    return a_graph([list(p.exterior.coords[:-1]) for p in kept], floor, prefix)


def moved(graph: SceneGraph, yaw: float, x: float, y: float, mirror: bool = False) -> SceneGraph:
    """The graph in another frame; `mirror` flips the x axis first, which no motion does."""
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    turn = turn @ np.diag([-1 if mirror else 1, 1])

    def at(p: tuple[float, float]) -> tuple[float, float]:
        q = turn @ np.array(p) + (x, y)
        return float(q[0]), float(q[1])

    def along(v: tuple[float, float]) -> tuple[float, float]:
        w = turn @ np.array(v)
        return float(w[0]), float(w[1])

    rooms = tuple(
        dataclasses.replace(r, centroid=at(r.centroid), polygon=r.polygon and tuple(at(p) for p in r.polygon))
        for r in graph.rooms
    )
    walls = tuple(dataclasses.replace(w, centroid=at(w.centroid), normal=along(w.normal)) for w in graph.wall_surfaces)
    doors = tuple(dataclasses.replace(d, centroid=at(d.centroid)) for d in graph.doors)
    return dataclasses.replace(graph, rooms=rooms, wall_surfaces=walls, doors=doors)
