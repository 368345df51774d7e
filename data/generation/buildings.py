"""Generates random buildings for training and tuning matchers; the same seed gives the same building."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely

from data.generation.apartments import apartment, treemap
from data.generation.storey import HALLS, Cell, Storey, Walls, built, furnished, is_rectangle
from data.generation.wings import racetrack, wing_cells, wings_drawn
from data.plans import Plan
from data.plans.polygons import MIN_EDGE, DrawnRoom, Points, edges_of, room_of, surfaces_of
from data.scene_graph import Door, Floor, Room, SceneGraph, WallSurface

Rng = np.random.Generator
KINDS = ("apartment", "office", "corridor", "l_shape", "skewed", "mirrored_twins", "tower")


def generate_plan(kind: str, seed: int, plain: bool = False) -> Plan:
    """A building of one of `KINDS` as an A-graph in metres, with one floor, a tower with three to eight; a `plain` one
    has no piers, niches and shafts at its walls.

    The same kind and seed give the same plan. Rooms do not overlap, neighbours are a wall apart (0.1 m or more),
    every wall surface lies on an edge of its room, and every room can be reached through doors if its neighbours
    allow one. Each (kind, seed) is its own building. Raises ValueError for an unknown kind.
    """
    if kind not in KINDS:
        raise ValueError(f"unknown kind '{kind}'; one of {', '.join(KINDS)}")
    rng = np.random.default_rng([KINDS.index(kind), seed])
    # half of the plans are aligned with the axes
    turn = 0.0 if rng.random() < 0.5 else float(rng.uniform(-np.pi, np.pi))
    c, s, at = np.cos(turn), np.sin(turn), rng.uniform(-50, 50, 2).tolist()
    built_ones = {"tower": _tower, "mirrored_twins": _mirrored_twins}.get(kind, _single)(kind, rng, plain)
    storeys = [storey.moved(np.array([[c, -s], [s, c]]), at) for storey in built_ones]
    name = f"{kind}_{seed}"
    return Plan(name, f"generated/{name}", _graph(storeys, float(rng.uniform(2.7, 3.8))))


def _graph(storeys: Sequence[Storey], height: float) -> SceneGraph:
    """Floors `0`, `1`, ... from the ground up."""
    rooms: list[Room] = []
    surfaces: list[WallSurface] = []
    doors: list[Door] = []
    floors: list[Floor] = []
    for level, storey in enumerate(storeys):
        low = level * height
        floors.append(Floor(f"{level}", f"Storey {level}", low))
        for k, (area, kind) in enumerate(zip(storey.rooms, storey.kinds, strict=True)):
            room = DrawnRoom(f"{level}/{k}", area, kind, f"{level}", (low, low + height - 0.25))
            rooms.append(room_of(room))
            surfaces += surfaces_of(room, edges_of(area), {}, MIN_EDGE)
        for k, (middle, joined) in enumerate(storey.doors):
            doors.append(Door(f"{level}/door{k}", tuple(f"{level}/{j}" for j in joined), middle))
    return SceneGraph("bim", tuple(rooms), tuple(surfaces), tuple(doors), tuple(floors))


def _layout(kind: str, rng: Rng) -> tuple[list[Cell], tuple[float, ...]]:
    """The cells of a storey, and the shares of rooms with features of which one is drawn."""
    match kind:
        case "apartment":
            return apartment(rng, int(rng.integers(4, 13))), (0.05, 0.2, 0.35)
        case "office":
            rooms = int(rng.integers(20, 81))
            return racetrack(rng, rooms) if rng.random() < 0.3 else _wings(rng, rooms, 0), (0.0, 0.03, 0.15)
        case "corridor":
            return _wings(rng, int(rng.integers(20, 71)), int(rng.integers(1, 4))), (0.0, 0.03, 0.15)
        case "l_shape":
            wings = wings_drawn(rng, int(rng.integers(16, 61)), 1)
            at_end = wings.depths[0] + wings.corridor / 2 if rng.random() < 0.7 else wings.corridor / 2
            branch = replace(wings.branches[0], x=at_end if rng.random() < 0.5 else wings.length - at_end)
            return wing_cells(rng, replace(wings, branches=(branch,), ends=False, halls=())), (0.0, 0.05, 0.2)
        case "mirrored_twins":
            if rng.random() < 0.6:
                return apartment(rng, int(rng.integers(5, 13))), (0.0, 0.1, 0.25)
            branches = int(rng.random() < 0.5)
            return _wings(rng, int(rng.integers(10, 31)), branches), (0.0, 0.1, 0.25)
    if rng.random() < 0.5:
        return apartment(rng, int(rng.integers(5, 13)), tilt=float(np.radians(rng.uniform(4, 16)))), (0.15,)
    if rng.random() < 0.5:
        cells = apartment(rng, int(rng.integers(5, 13)))
    else:
        cells = _wings(rng, int(rng.integers(12, 41)), int(rng.integers(0, 2)))
    return _skewed(cells, rng), (0.1,)


def _wings(rng: Rng, rooms: int, branches: int) -> list[Cell]:
    return wing_cells(rng, wings_drawn(rng, rooms, branches))


def _skewed(cells: Sequence[Cell], rng: Rng) -> list[Cell]:
    """The cells sheared and narrowed; straight walls stay straight."""
    x0, y0, x1, y1 = shapely.total_bounds([c.area for c in cells]).tolist()
    shear = float(rng.uniform(-0.3, 0.3))
    narrowing = rng.uniform(-0.25, 0.25, 2) / max(x1 - x0, y1 - y0)

    def skew(points: Points) -> Points:  # a projective map
        p = points - [(x0 + x1) / 2, (y0 + y1) / 2]
        return (p + shear * p[:, 1:] * [1.0, 0.0]) / (1 + p @ narrowing)[:, None]

    return [Cell(shapely.transform(c.area, skew), c.kind) for c in cells]


def _single(kind: str, rng: Rng, plain: bool) -> list[Storey]:
    cells, shares = _layout(kind, rng)
    share = float(rng.choice(shares)) * (not plain)
    return [furnished(built(cells, Walls.drawn(rng), rng), rng, share)]


def _mirrored_twins(kind: str, rng: Rng, plain: bool) -> list[Storey]:
    """A half and its mirror image, wall to wall or with stairs or a gap between them."""
    (half,) = _single(kind, rng, plain)
    _, y0, x1, y1 = shapely.total_bounds(half.rooms).tolist()
    gap = float(rng.choice([0.24, 0.3, 3.2, 12.0])) if rng.random() < 0.9 else float(rng.uniform(0.2, 20.0))
    both = half.joined(half.moved(np.diag([-1.0, 1.0]), (2 * x1 + gap, 0.0)))
    if 2.5 < gap < 4.0:
        stairs = shapely.box(x1 + 0.24, y0, x1 + gap - 0.24, y0 + min(6.0, y1 - y0))
        both = both.joined(Storey((stairs,), ("stairs",)))
    return [both]


def _tower(kind: str, rng: Rng, plain: bool) -> list[Storey]:
    """Storeys with one layout: identical, or with some additional walls; the ground floor may differ."""
    if rng.random() < 0.5:
        cells = apartment(rng, int(rng.integers(6, 13)))
    elif rng.random() < 0.4:
        cells = racetrack(rng, int(rng.integers(16, 31)))
    else:
        cells = _wings(rng, int(rng.integers(10, 31)), int(rng.integers(0, 2)))
    walls, seed = Walls.drawn(rng), int(rng.integers(2**32))
    change = float(rng.choice([0.0, 0.05, 0.15]))

    def storey(cells: Sequence[Cell]) -> Storey:  # the same doors and pillars on every storey
        again = np.random.default_rng(seed)
        return furnished(built(cells, walls, again), again, 0.0 if plain else 0.1)

    storeys = [storey(_rebuilt(cells, rng, change) if change else cells) for _ in range(int(rng.integers(3, 9)))]
    if rng.random() < 0.3:
        storeys[0] = storey(_rebuilt(cells, rng, 0.5))
    return storeys


def _rebuilt(cells: Sequence[Cell], rng: Rng, share: float) -> list[Cell]:
    """Some rooms are divided by a new wall."""
    result: list[Cell] = []
    for cell in cells:
        whole = is_rectangle(cell) and cell.kind not in HALLS and cell.area.area > 10
        if whole and rng.random() < share:
            part = float(rng.uniform(0.35, 0.65))
            result += treemap(rng, cell.area, [(cell.kind, part), (cell.kind, 1 - part)])
        else:
            result.append(cell)
    return result
