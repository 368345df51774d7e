"""Ways to divide a storey of a generated building into cells. Metres, in the building's own frame."""

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import Polygon, box

from data.generation.storey import Cell
from data.geometry.areas import Area, difference, largest, united

Rng = np.random.Generator
Spans = Sequence[tuple[float, float]]
FLAT_ROOMS = (  # kind, least and greatest area in m2, of an apartment's rooms after its living room
    ("bedroom", 10.0, 17.0), ("bathroom", 3.6, 7.0), ("kitchen", 7.0, 14.0), ("bedroom", 9.0, 15.0),
    ("wc", 1.9, 2.8), ("bedroom", 9.0, 14.0), ("storage", 2.2, 5.0), ("bathroom", 3.4, 6.0),
    ("study", 7.0, 12.0), ("bedroom", 9.0, 15.0), ("storage", 2.2, 4.0),
)  # fmt: skip


def apartment_program(rng: Rng, rooms: int) -> list[tuple[str, float]]:
    """Kinds and areas of an apartment's rooms, the living room first."""
    living = ("living", float(rng.uniform(18, 38)))
    rest = [(kind, float(rng.uniform(low, high))) for kind, low, high in FLAT_ROOMS]
    if rooms <= 6 and rng.random() < 0.5:
        rest[2], rest[3] = rest[3], rest[2]  # a kitchen in the living room
    return [living, *rest[: rooms - 1]]


def treemap(rng: Rng, area: Polygon, program: Sequence[tuple[str, float]], tilt: float = 0.0) -> list[Cell]:
    """Divides a convex area (a rectangle if `tilt` is 0) repeatedly in two, so that each room gets its share.

    `tilt` (rad) skews the cuts.
    """
    if len(program) == 1:
        return [Cell(area, program[0][0])]
    shuffled = [program[k] for k in rng.permutation(len(program))]
    cut = int(rng.integers(1, len(program))) if len(program) < 4 else int(rng.integers(2, len(program) - 1))
    first, second = shuffled[:cut], shuffled[cut:]
    share = sum(a for _, a in first) / sum(a for _, a in program)
    across = _wider(area) != (rng.random() < 0.12)
    if tilt:
        low, high = _cut(area, share, float(rng.uniform(-tilt, tilt)), across)
    else:
        low, high = _halves(area, share, across)
    return treemap(rng, low, first, tilt) + treemap(rng, high, second, tilt)


def _wider(area: Polygon) -> bool:
    x0, y0, x1, y1 = area.bounds
    return bool(x1 - x0 > y1 - y0)


def _halves(area: Polygon, share: float, across: bool) -> tuple[Polygon, Polygon]:
    x0, y0, x1, y1 = area.bounds
    if across:
        x = x0 + share * (x1 - x0)
        return box(x0, y0, x, y1), box(x, y0, x1, y1)
    y = y0 + share * (y1 - y0)
    return box(x0, y0, x1, y), box(x0, y, x1, y1)


def _cut(area: Polygon, share: float, tilt: float, across: bool) -> tuple[Polygon, Polygon]:
    """Two parts on both sides of a line, the first with its share; `across`: the line runs along y, else along x."""
    heading = tilt + (np.pi / 2 if across else 0.0)
    along = np.array([np.cos(heading), np.sin(heading)])
    normal = np.array([-along[1], along[0]])
    reach = np.asarray(area.exterior.coords) @ normal
    big = 4 * float(np.ptp(reach)) + area.length

    def before(level: float) -> Polygon:
        foot, side = normal * level, big * along
        middle = (np.asarray(area.centroid.coords)[0] @ along) * along
        corners = [foot + middle - side, foot + middle + side]
        return area.intersection(shapely.Polygon([*corners, *(c - big * normal for c in corners[::-1])]))

    low, high = float(reach.min()), float(reach.max())
    for _ in range(12):
        level = (low + high) / 2
        low, high = (level, high) if before(level).area < share * area.area else (low, level)
    part = before((low + high) / 2)
    return part, largest(difference(area, part))


def carved(rng: Rng, cells: list[Cell], share: float) -> list[Cell]:
    """Cuts a closet out of a corner of some large rooms, or joins them with a small neighbour, which gives L-shaped
    rooms.
    """
    result = []
    for cell in cells:
        x0, y0, x1, y1 = cell.area.bounds
        rectangle = cell.area.area > 0.999 * (x1 - x0) * (y1 - y0)
        if rectangle and cell.area.area > 11 and min(x1 - x0, y1 - y0) > 2.9 and rng.random() < share:
            width, depth = (float(min(rng.uniform(1.3, 2.4), 0.5 * side)) for side in (x1 - x0, y1 - y0))
            x, y = (x0 if rng.random() < 0.5 else x1 - width), (y0 if rng.random() < 0.5 else y1 - depth)
            closet = box(x, y, x + width, y + depth)
            result += [Cell(largest(difference(cell.area, closet)), cell.kind), Cell(closet, "storage")]
        else:
            result.append(cell)
    return result


def row(
    rng: Rng, span: tuple[float, float], y0: float, y1: float, module: float, variety: float, inner_y: float
) -> list[Cell]:
    """Rooms side by side within x of `span` and y0, y1: as many equal modules as fit.

    With probability `variety` a room takes two modules, or is divided in depth, its door side at `inner_y`.
    """
    count = max(1, round((span[1] - span[0]) / module))
    xs = np.linspace(*span, count + 1)
    cells, k = [], 0
    while k < count:
        wide = 1 + int(rng.random() < variety) + int(rng.random() < variety / 3)
        left, right = float(xs[k]), float(xs[min(k + wide, count)])
        k += wide
        if rng.random() < variety / 3 and y1 - y0 > 3.5:
            share = float(rng.uniform(0.35, 0.65))
            y = y0 + share * (y1 - y0)
            kinds = ("wc", "storage") if inner_y == y0 else ("storage", "wc")
            cells += [Cell(box(left, y0, right, y), kinds[0]), Cell(box(left, y, right, y1), kinds[1])]
        else:
            cells.append(Cell(box(left, y0, right, y1), "office"))
    return cells


def without_spans(span: tuple[float, float], taken: Spans, shortest: float) -> list[tuple[float, float]]:
    """The parts of `span` that no corridor crosses, in pieces of at least `shortest`."""
    pieces, start = [], span[0]
    for low, high in [*sorted(taken), (span[1], span[1])]:
        if low - start >= shortest:
            pieces.append((start, low))
        start = max(start, high)
    return pieces


def joined_cells(areas: Sequence[Area], kind: str) -> Cell:
    """Joins cells that touch."""
    return Cell(largest(united(areas)), kind)
