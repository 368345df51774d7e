"""Training data: pairs of a map and a plan, drawn for every step; step k of a seed is always the same batch."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from data.generation.buildings import generate_plan
from data.plans.sources import Plan, Split, split_of
from data.scene_graph import SceneGraph, Xy
from data.synthetic_maps.noise_models import DrawnGraph, draw
from matching.arrays import Index
from matching.proposals.features import GraphFeatures, map_features, plan_features

NOISE_SHARES = {"real": 0.32, "drift": 0.36, "mis_segmented": 0.26, "paper": 0.06}
ROOMS: dict[int | None, float] = {1: 0.06, 2: 0.18, 3: 0.16, 4: 0.2, 6: 0.16, 9: 0.17, None: 0.07}
KINDS = ("apartment", "office", "corridor", "l_shape", "skewed", "mirrored_twins", "tower", "campus")
KIND_SHARES = (0.22, 0.16, 0.14, 0.14, 0.12, 0.08, 0.12, 0.02)
FROM_FILES = 0.3
FOREIGN = 0.04  # share of maps of another plan, without any match
LENGTHLESS, ROOMLESS = 0.05, 0.04
PLANS, DRAWS = 4, 3  # of a batch, and maps of each plan
LEAST_WALLS, MOST_WALLS = 40, 320  # of a plan; larger ones are cut down to a part
HELD_OUT_NOISE, HELD_OUT_ROOMS = ("real", "drift", "mis_segmented"), (2, 4, 9, None)
HELD_OUT_PLANS = 6  # for each noise model and number of rooms, with two maps each
STRETCH = 0.18  # plans are stretched along x and y by up to so much, and every other one is mirrored


@dataclass(frozen=True)
class Pair:
    """A map drawn from a plan, with the true columns of its N walls and M rooms in the plan, -1 for none."""

    s: GraphFeatures
    plan: int  # its number in the batch
    walls: Index  # (N,)
    rooms: Index  # (M,)


@dataclass(frozen=True)
class Batch:
    """Plans, and the maps drawn from them."""

    plans: tuple[GraphFeatures, ...]
    pairs: tuple[Pair, ...]


@dataclass(frozen=True)
class Drawing:
    """The source of batches: plans from files, and generated ones by kind and seed; `seed` is that of the draws."""

    plans: tuple[Plan, ...]
    seeds: Mapping[str, tuple[int, ...]]
    seed: int

    def __getitem__(self, step: int) -> Batch:
        """Returns the batch of one step."""
        rng = np.random.default_rng([self.seed, step])
        groups: list[tuple[SceneGraph, list[DrawnGraph]]] = []
        while len(groups) < PLANS:
            most = int(LEAST_WALLS * (MOST_WALLS / LEAST_WALLS) ** rng.random())
            a = part(varied(self.plan(rng).graph, rng), most, rng)
            drawn = [d for _ in range(DRAWS) if (d := self._draw(a, rng)) is not None]
            if drawn and a.wall_surfaces:
                groups.append((a, drawn))
        return batch_of(groups)

    def plan(self, rng: np.random.Generator) -> Plan:
        """Returns a random plan."""
        if self.plans and (not self.seeds or rng.random() < FROM_FILES):
            return self.plans[int(rng.integers(len(self.plans)))]
        kind = str(rng.choice(KINDS, p=KIND_SHARES))
        return generated(kind, self.seeds[kind][int(rng.integers(len(self.seeds[kind])))])

    def _draw(self, a: SceneGraph, rng: np.random.Generator) -> DrawnGraph | None:
        foreign = rng.random() < FOREIGN
        seen = varied(self.plan(rng).graph, rng) if foreign else a
        noise = str(rng.choice(list(NOISE_SHARES), p=list(NOISE_SHARES.values())))
        rooms = list(ROOMS)[int(rng.choice(len(ROOMS), p=list(ROOMS.values())))]
        rooms = 6 if foreign and rooms is None else rooms
        if not seen.rooms:
            return None
        drawn = draw(seen, noise, rng, rooms)
        if not drawn.s_graph.wall_surfaces:
            return None
        if foreign:
            return replace(drawn, rooms={}, wall_surfaces={})
        return replace(drawn, s_graph=_poorer(drawn.s_graph, rng))


def seeds_of(split: Split, below: int) -> dict[str, tuple[int, ...]]:
    """The seeds below a number whose generated buildings are in a split, by kind."""
    return {kind: tuple(k for k in range(below) if split_of(f"generated/{kind}_{k}") == split) for kind in KINDS}


@lru_cache(maxsize=2048)
def generated(kind: str, seed: int) -> Plan:
    """A generated plan, the same object for the same seed."""
    return generate_plan(kind, seed)


def _poorer(s: SceneGraph, rng: np.random.Generator) -> SceneGraph:
    """Sometimes removes lengths or rooms, since maps of other programs may lack them."""
    lengthless, roomless = rng.random(2) < (LENGTHLESS, ROOMLESS)
    if lengthless:
        s = replace(s, wall_surfaces=tuple(replace(w, length=None) for w in s.wall_surfaces))
    if roomless:
        walls = tuple(replace(w, room=None) for w in s.wall_surfaces)
        s = replace(s, rooms=(), wall_surfaces=walls, doors=())
    return s


def batch_of(groups: Sequence[tuple[SceneGraph, Sequence[DrawnGraph]]]) -> Batch:
    """Returns a batch from plans and the maps drawn from each."""
    plans, pairs = [plan_features(a) for a, _ in groups], []
    for n, (plan, (_, drawn)) in enumerate(zip(plans, groups, strict=True)):
        wall_of = {w: k for k, w in enumerate(plan.wall_ids)}
        room_of = {r: k for k, r in enumerate(plan.room_ids)}
        for d in drawn:
            s = map_features(d.s_graph)
            walls = [wall_of.get(d.wall_surfaces.get(w, ""), -1) for w in s.wall_ids]
            rooms = [room_of.get(d.rooms.get(r, ""), -1) for r in s.room_ids]
            pairs.append(Pair(s, n, *(np.array(x, dtype=np.int64) for x in (walls, rooms))))
    return Batch(tuple(plans), tuple(pairs))


def varied(a: SceneGraph, rng: np.random.Generator) -> SceneGraph:
    """Returns the plan stretched along its axes, and mirrored in half of the cases."""
    stretch = rng.uniform(1 - STRETCH, 1 + STRETCH, 2) * [rng.choice([-1, 1]), 1]

    def moved(p: Xy) -> Xy:
        return (float(p[0] * stretch[0]), float(p[1] * stretch[1]))

    surfaces, rooms = [], []
    for w in a.wall_surfaces:
        x, y = np.array(w.normal) / stretch  # normals go with the inverse
        normal = (float(x / np.hypot(x, y)), float(y / np.hypot(x, y)))
        along = float(np.hypot(w.normal[1] * stretch[0], w.normal[0] * stretch[1]))
        length = None if w.length is None else w.length * along
        surfaces.append(replace(w, centroid=moved(w.centroid), normal=normal, length=length, plane=None))
    for r in a.rooms:
        ring = None if r.polygon is None else tuple(moved(p) for p in r.polygon)
        ring = ring[::-1] if ring is not None and stretch[0] < 0 else ring
        rooms.append(replace(r, centroid=moved(r.centroid), polygon=ring))
    doors = tuple(replace(d, centroid=moved(d.centroid)) for d in a.doors)
    return SceneGraph(a.frame, tuple(rooms), tuple(surfaces), doors, a.floors)


def part(a: SceneGraph, most: int, rng: np.random.Generator) -> SceneGraph:
    """Returns about `most` wall surfaces of a larger plan: of one storey, or of two; the rooms around one of them."""
    if len(a.wall_surfaces) <= most or not a.rooms:
        return a
    middle = a.rooms[int(rng.integers(len(a.rooms)))]
    others = [f for f in {r.floor: None for r in a.rooms} if f != middle.floor]
    floors = {middle.floor}
    if others and rng.random() < 0.4:
        floors.add(others[int(rng.integers(len(others)))])
    near = sorted((r for r in a.rooms if r.floor in floors), key=lambda r: math.dist(r.centroid, middle.centroid))
    walls = np.cumsum([len(a.surfaces_of_room[r.id]) for r in near])
    kept = {r.id for r in near[: 1 + np.searchsorted(walls, most, side="right")]}
    doors = [replace(d, rooms=tuple(r for r in d.rooms if r in kept)) for d in a.doors if kept.intersection(d.rooms)]
    return SceneGraph(
        a.frame,
        tuple(r for r in a.rooms if r.id in kept),
        tuple(w for w in a.wall_surfaces if w.room in kept),
        tuple(doors),
        tuple(f for f in a.floors if f.id in floors),
    )


def held_out(drawing: Drawing) -> dict[str, Batch]:
    """Returns a batch for each noise model and number of rooms, of unmodified plans."""
    found = {}
    for k, noise in enumerate(HELD_OUT_NOISE):
        for m, rooms in enumerate(HELD_OUT_ROOMS):
            rng = np.random.default_rng([drawing.seed, k, m])
            groups: list[tuple[SceneGraph, list[DrawnGraph]]] = []
            while len(groups) < HELD_OUT_PLANS:
                a = part(drawing.plan(rng).graph, MOST_WALLS, rng)
                drawn = [draw(a, noise, rng, rooms) for _ in range(2)] if len(a.rooms) >= (rooms or 1) else []
                drawn = [d for d in drawn if d.s_graph.wall_surfaces]
                if drawn:
                    groups.append((a, drawn))
            found[f"{noise} {rooms or 'all'}"] = batch_of(groups)
    return found
