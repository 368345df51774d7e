"""Apartments of generated buildings: rooms of given areas that tile an outline. Metres, in the building's own frame."""

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import Polygon, box

from data.generation.storey import Cell, is_rectangle
from data.geometry.areas import difference, largest

Rng = np.random.Generator
Program = Sequence[tuple[str, float]]  # kinds and areas (m2) of rooms
FLAT_ROOMS = (  # kind, least and greatest area in m2, of an apartment's rooms after its living room
    ("bedroom", 10.0, 17.0), ("bathroom", 3.6, 7.0), ("kitchen", 7.0, 14.0), ("bedroom", 9.0, 15.0),
    ("wc", 1.9, 2.8), ("bedroom", 9.0, 14.0), ("storage", 2.2, 5.0), ("bathroom", 3.4, 6.0),
    ("study", 7.0, 12.0), ("bedroom", 9.0, 15.0), ("storage", 2.2, 4.0),
)  # fmt: skip


def apartment_program(rng: Rng, rooms: int) -> Program:
    """Kinds and areas of an apartment's rooms, the living room first."""
    living = ("living", float(rng.uniform(18, 38)))
    rest = [(kind, float(rng.uniform(low, high))) for kind, low, high in FLAT_ROOMS]
    if rooms <= 6 and rng.random() < 0.5:
        rest[2], rest[3] = rest[3], rest[2]  # a kitchen in the living room
    return [living, *rest[: rooms - 1]]


def apartment(rng: Rng, rooms: int, tilt: float = 0.0) -> list[Cell]:
    """4 to 12 rooms: along a corridor, around a hall, or one behind another; some L-shaped. The best of a few tries."""
    tries = [_apartment(rng, rooms, tilt) for _ in range(8 if tilt else 16)]
    cells = min(tries, key=_worst)
    return cells if tilt else carved(rng, cells, 0.3)


def _worst(cells: Sequence[Cell]) -> float:
    """What the least usable room lacks: too narrow for its kind, or too long for its width."""
    worst = 0.0
    for cell in cells:
        x0, y0, x1, y1 = cell.area.bounds
        long = max(x1 - x0, y1 - y0)
        narrow = cell.area.area / long
        if cell.kind != "corridor":
            least = 1.15 if cell.area.area < 3.0 else 1.5 if cell.area.area < 8.0 else 2.4
            worst = max(worst, least / narrow, long / narrow / 2.2)
    return max(worst, 1.0)


def _apartment(rng: Rng, rooms: int, tilt: float) -> list[Cell]:
    program = apartment_program(rng, rooms)
    total = sum(area for _, area in program)
    width = float(np.sqrt(total * rng.uniform(1.0, 2.2)))
    depth = total / width
    style = rng.random()
    if tilt or style < 0.3:
        return _with_hall(treemap(rng, _outline(rng, width, depth, tilt), program, tilt))
    if style < 0.75 or rooms < 6:
        return _along_corridor(rng, program, width, depth)
    return _l_shaped(rng, program, width, depth)


def _outline(rng: Rng, width: float, depth: float, tilt: float) -> shapely.Polygon:
    slant = rng.uniform(-tilt, tilt, 4) * np.array([depth, depth, width, width]) / 2
    return shapely.Polygon([(slant[0], slant[2]), (width + slant[1], 0), (width, depth + slant[3]), (0, depth)])


def _with_hall(cells: list[Cell]) -> list[Cell]:
    """Makes the room with most neighbours the hall."""
    areas = np.array([c.area for c in cells], dtype=object)
    hall = int(np.argmax([int((shapely.distance(areas, a) < 1e-3).sum()) for a in areas]))
    return [Cell(c.area, "hall" if k == hall else c.kind) for k, c in enumerate(cells)]


def _along_corridor(rng: Rng, program: Program, width: float, depth: float) -> list[Cell]:
    """Rooms on both sides of a corridor, and the living room at its end in half of the cases."""
    hall = float(rng.uniform(1.25, 1.9))
    rest, cells, length = program, [], width
    if len(program) > 4 and rng.random() < 0.5:
        rest, length = program[1:], width - program[0][1] / depth
        cells.append(Cell(box(length, 0, width, depth + hall), "living"))
    order = [rest[k] for k in rng.permutation(len(rest))]
    cut = min(max(1, len(order) // 2 + int(rng.integers(-1, 2))), len(order) - 1)
    sides = order[:cut], order[cut:]
    totals = [sum(a for _, a in side) for side in sides]
    low = depth * min(max(totals[0] / sum(totals), 0.3), 0.7)
    for side, y0, y1 in zip(sides, (0.0, low + hall), (low, depth + hall), strict=True):
        cells += _strip(rng, side, length, y0, y1)
    return [*cells, Cell(box(0, low, length, low + hall), "corridor")]


def _strip(rng: Rng, program: Program, length: float, y0: float, y1: float) -> list[Cell]:
    """Rooms side by side in proportion to their areas; neighbours too narrow for that lie one behind the other."""
    groups: list[list[tuple[str, float]]] = []
    scale = length / sum(a for _, a in program)
    for item in program:
        if groups and sum(a for _, a in groups[-1]) * scale < 1.9:
            groups[-1].append(item)
        else:
            groups.append([item])
    if len(groups) > 1 and sum(a for _, a in groups[-1]) * scale < 1.9:
        last = groups.pop()
        groups[-1] += last
    x, cells = 0.0, []
    for group in groups:
        wide = sum(a for _, a in group) * scale
        cells += treemap(rng, box(x, y0, x + wide, y1), group)
        x += wide
    return cells


def _l_shaped(rng: Rng, program: Program, width: float, depth: float) -> list[Cell]:
    """An L of two parts with a hall at its inner corner."""
    cut = int(rng.integers(3, max(4, len(program) - 2)))
    first, second = program[:cut], program[cut:]
    low = _along_corridor(rng, first, width, sum(a for _, a in first) / width)
    top = max(c.area.bounds[3] for c in low)
    wide = width * float(rng.uniform(0.4, 0.65))
    high = sum(a for _, a in second) / wide
    left = 0.0 if rng.random() < 0.5 else width - wide
    return [*low, *_with_hall(treemap(rng, box(left, top, left + wide, top + high), second))]


def treemap(rng: Rng, area: Polygon, program: Program, tilt: float = 0.0) -> list[Cell]:
    """Divides a convex area (a rectangle if `tilt` is 0) repeatedly in two, so that each room gets its share.

    `tilt` (rad) skews the cuts.
    """
    if len(program) == 1:
        return [Cell(area, program[0][0])]
    shuffled = [program[k] for k in rng.permutation(len(program))]
    cut = int(rng.integers(1, len(program))) if len(program) < 4 else int(rng.integers(2, len(program) - 1))
    first, second = shuffled[:cut], shuffled[cut:]
    share = sum(a for _, a in first) / sum(a for _, a in program)
    x0, y0, x1, y1 = area.bounds
    across = (x1 - x0 > y1 - y0) != (rng.random() < 0.12)
    if tilt:
        low, high = _cut(area, share, float(rng.uniform(-tilt, tilt)), across)
    elif across:
        x = x0 + share * (x1 - x0)
        low, high = box(x0, y0, x, y1), box(x, y0, x1, y1)
    else:
        y = y0 + share * (y1 - y0)
        low, high = box(x0, y0, x1, y), box(x0, y, x1, y1)
    return treemap(rng, low, first, tilt) + treemap(rng, high, second, tilt)


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
    """Cuts a closet out of a corner of some large rooms, which gives L-shaped rooms."""
    result = []
    for cell in cells:
        x0, y0, x1, y1 = cell.area.bounds
        large = is_rectangle(cell) and cell.area.area > 11 and min(x1 - x0, y1 - y0) > 2.9
        if large and rng.random() < share:
            width, depth = (float(min(rng.uniform(1.3, 2.4), 0.5 * side)) for side in (x1 - x0, y1 - y0))
            x, y = (x0 if rng.random() < 0.5 else x1 - width), (y0 if rng.random() < 0.5 else y1 - depth)
            closet = box(x, y, x + width, y + depth)
            result += [Cell(largest(difference(cell.area, closet)), cell.kind), Cell(closet, "storage")]
        else:
            result.append(cell)
    return result
