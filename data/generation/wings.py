"""Wings of rooms along corridors, and two corridors around a core. Metres, in the building's own frame."""

from dataclasses import dataclass

import numpy as np
import shapely
from shapely import box

from data.generation.storey import Cell
from data.geometry.areas import largest, overlap, united
from data.geometry.intervals import without

Rng = np.random.Generator
LONGEST = 50.0  # m: longer buildings have another wing


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
    halls: tuple[tuple[float, float], ...] = ()  # x from and to of open-plan rooms above


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
    return [*cells, Cell(largest(united(corridors)), "corridor")]


def _main_row(rng: Rng, wings: Wings, up: bool, depth: float) -> list[Cell]:
    half, cells = wings.corridor / 2, []
    y0, y1 = (half, half + depth) if up else (-half - depth, -half)
    crossed = [(b.x - half, b.x + half) for b in wings.branches if b.upwards == up]
    halls = [h for h in wings.halls if up and all(h[1] < a or b < h[0] for a, b in crossed)]
    cells += [Cell(box(low, y0, high, y1), "open plan") for low, high in halls]
    for low, high in without([(0.0, wings.length)], [*crossed, *halls]):
        if high - low >= 0.05:
            cells += row(rng, (low, high), y0, y1, wings.module, wings.variety, y0 if up else y1)
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
