"""Features of generated rooms: pillars, piers, service shafts and niches."""

from dataclasses import replace

import numpy as np
import shapely

from data.generation.storey import DOOR_CLEAR, HALLS, Storey
from data.geometry.areas import Area
from data.plans.polygons import Points, edges_of, frame_of

Rng = np.random.Generator


def furnished(storey: Storey, rng: Rng, share: float) -> Storey:
    """Adds a feature to each room with the probability `share`; large rooms get pillars. Doors stay clear.

    Features lie within the room, so that walls keep their thickness.
    """
    doors: dict[int, list[tuple[float, float]]] = {}
    for at, rooms in storey.doors:
        for room in rooms:
            doors.setdefault(room, []).append(at)
    changed = []
    for k, (area, kind) in enumerate(zip(storey.rooms, storey.kinds, strict=True)):
        chance = share * (2.5 if kind in ("bathroom", "wc", "kitchen") else 1.0)
        clear = shapely.MultiPoint(doors.get(k, [])).buffer(DOOR_CLEAR)
        if area.area > 60 and kind not in HALLS and rng.random() < 0.6:
            area = _with_pillars(area, clear, rng)
        elif rng.random() < chance:
            area = _less(area, _standing(area, rng, shaft=rng.random() < 0.5), clear)
        changed.append(area)
    return replace(storey, rooms=tuple(changed))


def _standing(area: Area, rng: Rng, shaft: bool) -> Area:
    """A shaft in a corner, or a pier or a niche's side at a wall."""
    edges = edges_of(area)
    along, inward, length = frame_of(edges)
    k = int(rng.choice(len(length), p=length / length.sum()))
    width, depth = float(rng.uniform(0.25, 0.8)), float(rng.uniform(0.15, 0.6))
    if shaft:
        return _box(edges, along, inward, k, 0.0, width, depth)
    start = float(rng.uniform(0.2, 0.8)) * max(length[k] - width, 0.0)
    return _box(edges, along, inward, k, start, width, min(depth, 0.4))


def _box(edges: Points, along: Points, inward: Points, k: int, start: float, width: float, depth: float) -> Area:
    """Against edge k; it reaches a little over the edge, and over the corner where it stands in one."""
    foot = edges[k, 0] + along[k] * (start if start > 0 else -0.05)
    wide, deep = along[k] * (width + (0.0 if start > 0 else 0.05)), inward[k] * (depth + 0.05)
    foot = foot - 0.05 * inward[k]
    return shapely.Polygon([foot, foot + wide, foot + wide + deep, foot + deep])


def _less(area: Area, part: Area, clear: Area) -> Area:
    """The area without the part, unless that blocks a door, divides the room or leaves a sliver."""
    if part.intersects(clear):
        return area
    rest = shapely.difference(area, part)
    narrow = rest.buffer(-0.3, join_style="mitre")
    whole = rest.geom_type == "Polygon" and narrow.geom_type == "Polygon" and not narrow.is_empty
    fine = whole and frame_of(edges_of(rest))[2].min() > 0.06 and not rest.interiors
    return rest if fine else area


def _with_pillars(area: Area, clear: Area, rng: Rng) -> Area:
    """A grid of square or round pillars, each at least 0.8 m from the walls."""
    step, size = float(rng.uniform(4.5, 8.0)), float(rng.uniform(0.3, 0.6))
    box = shapely.oriented_envelope(area)
    corners = np.asarray(box.exterior.coords)[:4]
    u, v = corners[1] - corners[0], corners[3] - corners[0]
    a, b = u / np.hypot(*u), v / np.hypot(*v)
    inner = area.buffer(-0.8 - size)
    sides = 8 if rng.random() < 0.3 else 4
    turn = np.pi / sides + 2 * np.pi * np.arange(sides) / sides
    corner = size / (2 * np.cos(np.pi / sides)) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    shape = corner @ np.array([a, b])
    pillars = []
    for i in range(1, int(np.hypot(*u) / step) + 1):
        for j in range(1, int(np.hypot(*v) / step) + 1):
            at = corners[0] + u * i / (int(np.hypot(*u) / step) + 1) + v * j / (int(np.hypot(*v) / step) + 1)
            if inner.contains(shapely.Point(at)) and not clear.contains(shapely.Point(at)):
                pillars.append(shapely.Polygon(at + shape))
    return shapely.difference(area, shapely.union_all(pillars)) if pillars else area
