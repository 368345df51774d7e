"""Layouts of generated storeys: apartments, and wings of rooms along corridors. Metres, in the building's own frame."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely
from shapely import box

from data.generation.cells import apartment_program, carved, joined_cells, row, treemap, without_spans
from data.generation.storey import Cell
from data.geometry.areas import largest, overlap

Rng = np.random.Generator
LONGEST = 50.0  # m: longer buildings have another wing


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


def _along_corridor(rng: Rng, program: list[tuple[str, float]], width: float, depth: float) -> list[Cell]:
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


def _strip(rng: Rng, program: Sequence[tuple[str, float]], length: float, y0: float, y1: float) -> list[Cell]:
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


def _l_shaped(rng: Rng, program: list[tuple[str, float]], width: float, depth: float) -> list[Cell]:
    """An L of two parts with a hall at its inner corner."""
    cut = int(rng.integers(3, max(4, len(program) - 2)))
    first, second = program[:cut], program[cut:]
    low = _along_corridor(rng, first, width, sum(a for _, a in first) / width)
    top = max(c.area.bounds[3] for c in low)
    wide = width * float(rng.uniform(0.4, 0.65))
    high = sum(a for _, a in second) / wide
    left = 0.0 if rng.random() < 0.5 else width - wide
    return [*low, *_with_hall(treemap(rng, box(left, top, left + wide, top + high), second))]


@dataclass(frozen=True)
class Branch:
    """A wing that leaves the main one at `x` (the middle of its corridor), upwards or downwards."""

    x: float
    length: float
    upwards: bool = True


@dataclass(frozen=True)
class Wings:
    """A main wing of `length` along x, its corridor at y = 0, and its branches."""

    length: float
    module: float  # width of one room
    depths: tuple[float, float]  # of the rows above and below the corridor; 0: no row
    corridor: float
    variety: float  # probability that a room differs
    branches: tuple[Branch, ...] = ()
    split: bool = False  # doors divide the corridors where wings meet
    ends: bool = False  # a room closes each end of the main corridor
    halls: tuple[tuple[float, float], ...] = field(default=())  # x from and to of open-plan rooms above


def wings_drawn(rng: Rng, rooms: int, branches: int) -> Wings:
    """Draws sizes for about this many rooms, as in real offices, schools and clinics."""
    module = float(rng.choice([2.5, 2.7, 3.0, 3.6, 4.2, 5.0])) * float(rng.uniform(0.96, 1.04))
    run = rooms * module
    while branches < 3 and run > LONGEST * (2 + branches):
        branches += 1
    single = branches == 0 and rooms < 30 and rng.random() < 0.15
    upper = float(rng.uniform(3.8, 6.5))
    lower = 0.0 if single else upper if rng.random() < 0.5 else float(rng.uniform(3.2, 6.5))
    corridor = float(rng.uniform(1.5, 2.6))
    variety = 0.0 if rng.random() < 0.3 else float(rng.uniform(0.05, 0.35))
    run = rooms * module * (1 + 0.8 * variety) / (1 if single else 2)
    share = rng.dirichlet(np.full(branches + 1, 8.0)) if branches else np.ones(1)
    length = float(max(run * share[0], (branches + 1) * (2 * upper + corridor), 4 * module))
    sides = rng.random(branches) < 0.7
    # wings on one side must not run into each other
    xs = (np.arange(branches) + rng.uniform(0.4, 0.6, branches)) * length / max(branches, 1)
    drawn = tuple(
        Branch(float(x), float(max(run * s, 2 * module)), bool(u)) for x, s, u in zip(xs, share[1:], sides, strict=True)
    )
    start = float(rng.uniform(0.05, 0.6)) * length
    hall = ((start, min(start + module * float(rng.integers(3, 7)), length)),) if rng.random() < 0.2 else ()
    return Wings(length, module, (upper, lower), corridor, variety, drawn, bool(rng.random() < 0.5),
                 bool(rng.random() < 0.4), hall)  # fmt: skip


def wing_cells(rng: Rng, wings: Wings) -> list[Cell]:
    """Returns corridors and the rows of rooms along them."""
    upper, lower = wings.depths
    half, length = wings.corridor / 2, wings.length
    cells, corridors = [], [box(0, -half, length, half)]
    if wings.ends:
        end = wings.module
        cells += [
            Cell(box(-end, -half - lower, 0, half + upper), "office"),
            Cell(box(length, -half - lower, length + end, half + upper), "office"),
        ]
    for branch in wings.branches:
        parts, corridor = _branch(rng, wings, branch)
        cells += parts
        corridors.append(corridor)
    for up, depth in ((True, upper), (False, lower)):
        if depth:
            cells += _main_row(rng, wings, up, depth)
    if wings.split:
        return cells + [Cell(c, "corridor") for c in corridors]
    return [*cells, joined_cells(corridors, "corridor")]


def _main_row(rng: Rng, wings: Wings, up: bool, depth: float) -> list[Cell]:
    half, cells = wings.corridor / 2, []
    y0, y1 = (half, half + depth) if up else (-half - depth, -half)
    crossed = [(b.x - half, b.x + half) for b in wings.branches if b.upwards == up]
    halls = [h for h in wings.halls if up and all(h[1] < a or b < h[0] for a, b in crossed)]
    cells += [Cell(box(low, y0, high, y1), "open plan") for low, high in halls]
    for span in without_spans((0.0, wings.length), [*crossed, *halls], 0.05):
        cells += row(rng, span, y0, y1, wings.module, wings.variety, y0 if up else y1)
    return cells


def _branch(rng: Rng, wings: Wings, branch: Branch) -> tuple[list[Cell], shapely.Polygon]:
    """Rooms left and right of a branch's corridor, from the main wing's outer side on; and that corridor."""
    half = wings.corridor / 2
    start = half + wings.depths[0 if branch.upwards else 1]
    spans = (start, start + branch.length)
    low, high = half, half + wings.depths[0]
    cells = row(rng, spans, low, high, wings.module, wings.variety, low)
    cells += row(rng, spans, -high, -low, wings.module, wings.variety, -low)
    corridor = box(half, -half, spans[1], half)
    turn = 1.0 if branch.upwards else -1.0

    def place(points: np.ndarray) -> np.ndarray:  # along x to along y
        return np.stack([branch.x - points[:, 1], turn * points[:, 0]], axis=1)

    return [Cell(shapely.transform(c.area, place), c.kind) for c in cells], shapely.transform(corridor, place)


def racetrack(rng: Rng, rooms: int) -> list[Cell]:
    """Two parallel corridors around a core without windows, rows of rooms outside, links at the ends."""
    module = float(rng.choice([2.5, 2.7, 3.0, 3.6, 4.2])) * float(rng.uniform(0.96, 1.04))
    depth, core = float(rng.uniform(4.0, 6.0)), float(rng.uniform(4.5, 8.0))
    corridor, variety = float(rng.uniform(1.5, 2.2)), float(rng.uniform(0.0, 0.3))
    length = max(rooms * module / 2.8, 5 * module)
    y = np.cumsum([0.0, depth, corridor, core, corridor, depth]).tolist()
    middle = length * float(rng.uniform(0.35, 0.65))
    cells = row(rng, (0.0, length), y[0], y[1], module, variety, y[1])
    cells += row(rng, (0.0, length), y[4], y[5], module, variety, y[4])
    cells += row(rng, (corridor, length - corridor), y[2], y[3], 1.5 * module, 2 * variety, y[2])
    ring = shapely.difference(box(0, y[1], length, y[4]), box(corridor, y[2], length - corridor, y[3]))
    halves = (box(0, y[1], middle, y[4]), box(middle, y[1], length, y[4]))
    return cells + [Cell(largest(overlap(ring, part)), "corridor") for part in halves]
