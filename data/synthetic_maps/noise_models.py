"""Draws S-graphs from A-graphs: with the published perturbation, or like LiDAR maps of real buildings.

| noise model | rooms | noise |
|---|---|---|
| `paper` | rooms and walls dropped at random | the perturbation with which the published matcher was trained |
| `real` | a connected set of rooms | walls with the noise of real scans, missing, in pieces, clutter |
| `drift` | the same | the same, and each step from room to room adds to the rooms' motion |
| `mis_segmented` | the same | drift, and rooms merged and split, surfaces without a room |
| `heavy_drift` | the same | drift with three times the error per step, as in maps without tracking by walls |

The published perturbation is that of the public code (snt-arg, graph_matching_gnn and situational_graphs_datasets: room
and wall dropout, global noise, local noise). Rooms are dropped independently, with their walls, so the rest need not be
connected. The rotation is about the origin of the A-graph's own frame; lengths and room positions are exact.

The S-graph shows nothing of the plan but the observed wall surfaces: an S room has no footprint, its centroid is that
of the box of its surfaces; names, sources, heights and ids of the plan are missing, and the order is random. The map's
origin and heading are those of a robot that started somewhere in one of the rooms.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from data.common.errors import UserError
from data.geometry import se2
from data.geometry.se2 import Array, fit_to_lines
from data.scene_graph import Door, Floor, Room, SceneGraph, WallSurface, Xy
from data.scene_graph.nodes import xy_of
from data.synthetic_maps.exploration import Index, Storey, Walk, storeys_of, walk
from data.synthetic_maps.wall_noise import (
    DOOR_MISSING,
    USUAL,
    NoiseLevels,
    ObservedWalls,
    Passage,
    as_entered,
    mis_segmented,
    observe_walls,
    passages,
    true_rooms,
)

NOISE_MODELS = ("paper", "real", "drift", "mis_segmented", "heavy_drift")
DRIFT_YAW, DRIFT_XY = float(np.radians(1.5)), 0.15  # sigmas of each step from room to room: rad; m along each axis
HEAVY_DRIFT = 3.0  # times the errors of `drift`
SIGMA_DOOR = 0.1  # m along each axis
FLOOR_ID = "floor-0"
Motion = tuple[float, float, float]
DROPPED = 0.15  # of the rooms, and of the walls of those that are left
SHIFT = 0.01  # m: the width of the uniform shift of the whole graph along each axis,
LOCAL_SHIFT = 0.01  # and of each wall's centre;
LOCAL_TURN = float(np.radians(0.012 * 360))  # and of each wall's normal


@dataclass(frozen=True)
class DrawnGraph:
    """An S-graph and its true matches from S ids to A ids; clutter has none.

    Motions are (yaw, x, y) in rad and m, p_a = R(yaw) p_s + (x, y). `T_a_s_by_room` holds each S room's own true
    motion. `T_a_s` is the motion of the map; for a `deformed` one the best rigid fit of the true wall matches (ends of
    S surfaces to lines of A surfaces). A room split in two occurs twice in `rooms`. The truth for a merged room is the
    A room with most of its walls, by length; its other walls keep their own true match, but that room's motion is not
    given. `floor` is the A floor's id.
    """

    s_graph: SceneGraph
    rooms: Mapping[str, str]
    wall_surfaces: Mapping[str, str]
    T_a_s: Motion
    T_a_s_by_room: Mapping[str, Motion]
    floor: str | None
    deformed: bool


def draw(
    a: SceneGraph,
    noise: str,
    rng: np.random.Generator,
    rooms: int | None = None,
    floor: str | None = None,
    levels: NoiseLevels = USUAL,
) -> DrawnGraph:
    """Draws an S-graph of one floor of an A-graph with one of NOISE_MODELS.

    `levels` change all noise models but `paper`. `rooms` is the number of rooms to explore, None for the whole floor;
    fewer are explored if fewer are connected. Rooms without any observation are not in the S-graph. `paper` drops its
    own share of rooms and ignores `rooms`. With `floor` None the floor is drawn among those whose rooms have wall
    surfaces. The same generator state gives the same graph.

    Raises UserError for an unknown noise model or floor, a graph without rooms that have wall surfaces, and `rooms` <
    1.
    """
    if noise not in NOISE_MODELS:
        raise UserError(f"no noise model '{noise}' of S-graphs; there are: {', '.join(NOISE_MODELS)}")
    storeys = {storey.floor: storey for storey in storeys_of(a)}
    if not storeys:
        raise UserError("the A-graph has no room with wall surfaces; an S-graph cannot be drawn from it")
    if floor is not None and floor not in storeys:
        there = ", ".join(map(str, storeys))
        raise UserError(f"the A-graph has no floor '{floor}' with rooms; there are: {there}")
    storey = storeys[floor] if floor is not None else list(storeys.values())[int(rng.integers(len(storeys)))]
    while True:  # of a small part of a plan it may happen that nothing is seen
        if noise == "paper":
            drawn = _paper(storey, rng)
        else:
            drawn = draw_walk(storey, walk(storey, rng, rooms), noise, rng, levels)
        if drawn.rooms:
            return drawn


def perfect_map(a: SceneGraph, rooms: Collection[str]) -> DrawnGraph:
    """Returns a noise-free map of some rooms of one storey (at least one), in the A-graph's frame and with its ids."""
    part = SceneGraph(
        "map",
        tuple(r for r in a.rooms if r.id in rooms),
        tuple(w for w in a.wall_surfaces if w.room in rooms),
        tuple(d for d in a.doors if len(d.rooms) > 1 and set(rooms).issuperset(d.rooms)),
    )
    own, still = {r.id: r.id for r in part.rooms}, (0.0, 0.0, 0.0)
    floor = next((r.floor or w.floor for r in part.rooms for w in a.surfaces_of_room[r.id]), part.rooms[0].floor)
    return DrawnGraph(
        part, own, {w.id: w.id for w in part.wall_surfaces}, still, dict.fromkeys(own, still), floor, False
    )


def _paper(storey: Storey, rng: np.random.Generator) -> DrawnGraph:
    """Of at least one room with walls; the shift is at most 5 mm along each axis, the rotation about the origin."""
    walled = np.flatnonzero([len(w) > 0 for w in storey.walls_of])
    rooms = walled[:0]
    while not len(rooms):
        rooms = walled[rng.random(len(walled)) >= DROPPED]
    yaw = rng.uniform(0, 2 * np.pi)
    T_map_a = np.array([se2.wrap(np.array(yaw)), *se2.rotate(yaw, SHIFT * (rng.random(2) - 0.5))])
    walked = Walk(tuple(rooms.tolist()), (-1,) * len(rooms))
    seen, place = as_entered(_surviving_walls(storey, rooms, rng), walked), se2.apply(T_map_a, storey.middle[rooms])
    motions = dict.fromkeys(walked.rooms, T_map_a)
    return _built(storey, seen, passages(storey, walked), motions, rng, False, place)


def draw_walk(
    storey: Storey, walked: Walk, noise: str, rng: np.random.Generator, levels: NoiseLevels = USUAL
) -> DrawnGraph:
    """Draws the S-graph of a walk through a storey with any noise but that of `paper`; rooms without any observation
    are not in it."""
    seen, deformed = observe_walls(storey, walked, rng, levels), noise != "real"
    doors = [door for door in passages(storey, walked) if rng.random() >= DOOR_MISSING]
    if noise == "mis_segmented":
        seen, doors = mis_segmented(seen, doors, walked, rng, levels)
    start = storey.somewhere_in(walked.rooms[0], rng)
    yaw = rng.uniform(-np.pi, np.pi)
    T_map_a = np.array([yaw, *se2.rotate(yaw, -start)])
    factor = levels.sigma * (HEAVY_DRIFT if noise == "heavy_drift" else 1.0)
    motions = _drifted(storey, walked, T_map_a, factor, rng) if deformed else dict.fromkeys(walked.rooms, T_map_a)
    return _built(storey, seen, doors, motions, rng, deformed)


def _drifted(storey: Storey, walked: Walk, T_map_a: Array, factor: float, rng: np.random.Generator) -> dict[int, Array]:
    """T_map_a of each room: that of the room it was entered from, plus a random step about its centroid."""
    motions: list[Array] = []
    for room, parent in zip(walked.rooms, walked.parents, strict=True):
        if parent < 0:
            motions.append(T_map_a)
            continue
        yaw, middle = rng.normal(0, factor * DRIFT_YAW), storey.middle[room]
        step = np.array([yaw, *(middle - se2.rotate(yaw, middle) + rng.normal(0, factor * DRIFT_XY, 2))])
        motions.append(se2.compose(motions[parent], step))
    return dict(zip(walked.rooms, motions, strict=True))


def _built(
    storey: Storey, seen: ObservedWalls, doors: Sequence[Passage], motions: Mapping[int, Array],
    rng: np.random.Generator, deformed: bool, places: Array | None = None,
) -> DrawnGraph:  # fmt: skip
    """Returns the graph in the map frame, in random order.

    `motions` are T_map_a by A room, the map's own first; `places` (map rooms, 2) are the rooms' centroids in the map,
    None for those of the boxes of their surfaces.
    """
    truth = true_rooms(seen)
    T = np.array([motions[r] for r in seen.room.tolist()]).reshape(-1, 3)
    centre, arm = se2.apply(T, seen.centre), se2.rotate(T[:, 0], seen.arm)
    T_a_s = se2.inverse(next(iter(motions.values())))
    if deformed:
        true = np.flatnonzero(seen.wall >= 0)
        ends, lines = np.concatenate((centre[true] + arm[true], centre[true] - arm[true])), np.tile(seen.wall[true], 2)
        T_a_s = fit_to_lines(ends, storey.centre[lines], storey.normal[lines], T_a_s)
    known = list(truth)
    names = {known[k]: f"R{n}" for n, k in enumerate(rng.permutation(len(known)).tolist())}
    rooms = []
    for home, name in names.items():
        mine = seen.home == home
        place = _box_centre(centre[mine], arm[mine]) if places is None else places[home]
        rooms.append(Room(name, xy_of(place), FLOOR_ID))
    order = rng.permutation(len(seen))
    heading = seen.heading + T[:, 0]
    normal = np.stack((np.cos(heading), np.sin(heading)), axis=-1)
    walls = tuple(
        WallSurface(
            f"W{n}", names.get(int(seen.home[k])), xy_of(centre[k]), xy_of(normal[k]),
            None if np.isnan(seen.length[k]) else float(seen.length[k]), FLOOR_ID,
        )
        for n, k in enumerate(order)
    )  # fmt: skip
    found = list[tuple[tuple[str, ...], Xy]]()
    for door in doors:
        if all(room in names for room in door.rooms):
            place = se2.apply(motions[door.seen_from], door.place)
            place += (SIGMA_DOOR if places is None else 0.0) * rng.normal(size=2)
            found.append((tuple(sorted(names[room] for room in door.rooms)), xy_of(place)))
    mapped = tuple(Door(f"D{n}", *own) for n, own in enumerate(sorted(found)))
    wall_truth = {w.id: storey.ids[seen.wall[k]] for w, k in zip(walls, order, strict=True) if seen.wall[k] >= 0}
    return DrawnGraph(
        SceneGraph("map", tuple(rooms), walls, mapped, (Floor(FLOOR_ID),)),
        {name: storey.rooms[truth[home]].id for home, name in names.items()}, wall_truth, _triple(T_a_s),
        {name: _triple(se2.inverse(motions[truth[home]])) for home, name in names.items()}, storey.floor, deformed,
    )  # fmt: skip


def _box_centre(centre: Array, arm: Array) -> Array:
    """(2,) the middle of the box around the surfaces, aligned with the longest of them."""
    longest = arm[np.hypot(*arm.T).argmax()]
    grid = float(np.arctan2(longest[1], longest[0]))
    ends = se2.rotate(-grid, np.concatenate((centre + arm, centre - arm)))
    return se2.rotate(grid, (ends.min(axis=0) + ends.max(axis=0)) / 2)


def _triple(T: Array) -> Motion:
    yaw, x, y = T.tolist()
    return yaw, x, y


def _surviving_walls(storey: Storey, rooms: Index, rng: np.random.Generator) -> ObservedWalls:
    """Returns the remaining walls of these rooms, with local noise.

    A wall drawn for dropout is only dropped if more than one of it and its two neighbours in the room's ring remain.
    """
    kept = []
    for room in rooms.tolist():
        ring = _ring(storey, room)
        left = np.ones(len(ring), dtype=bool)
        for k in np.flatnonzero(rng.random(len(ring)) < DROPPED).tolist():
            around = {(k - 1) % len(ring), k, (k + 1) % len(ring)}
            left[k] = left[list(around)].sum() <= 1
        kept.append(ring[left])
    wall = np.concatenate(kept)
    centre = storey.centre[wall] + LOCAL_SHIFT * (rng.random((len(wall), 2)) - 0.5)
    heading = storey.heading[wall] + LOCAL_TURN * (rng.random(len(wall)) - 0.5)
    return ObservedWalls(centre, heading, storey.half[wall], wall, storey.room[wall], storey.room[wall])


def _ring(storey: Storey, room: int) -> Index:
    """A room's walls in order around the room."""
    walls = storey.walls_of[room]
    area = storey.areas[room]
    if area is not None and area.geom_type == "Polygon":
        return walls[np.argsort(shapely.line_locate_point(area.exterior, shapely.points(storey.centre[walls])))]
    around = storey.centre[walls] - storey.middle[room]
    return walls[np.argsort(np.arctan2(around[:, 1], around[:, 0]))]
