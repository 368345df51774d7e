"""Finds a plan's symmetries: other places that explain a perfect map about as well as its true one.

No matcher can be blamed for leaving such a pair of places ambiguous. The map's own walls are placed elsewhere in the
plan by the engine of all matchers: turned, in another row of offices, on another storey. Another place is a symmetry if
an observer who knows the noise of maps expects less than ln(199) = 5.3 nats of evidence for the truth over it. The
observed evidence scatters about the expected one with twice the latter as its variance: at 5.3 nats the observer is
less than 99.5 % sure of the truth in every second map; below one nat he is hardly ever sure.

The expected evidence between two Gaussian hypotheses that differ by d_k in the measurements k is
sum d_k^2 / (2 sigma_k^2). It is the difference of the engine's log likelihoods of a map without noise, for known sigmas
instead of marginal ones: 0.061 m across and 0.346 m at each end (`data.synthetic_maps.wall_noise`).
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from data import SceneGraph
from data.geometry import se2
from data.synthetic_maps.exploration import Storey, storeys_of
from data.synthetic_maps.noise_models import perfect_map
from data.synthetic_maps.wall_noise import SIGMA_ACROSS, SIGMA_END, USUAL
from matching.arrays.walls import between_graphs
from matching.engine.alternatives import alternative_placements
from matching.engine.evidence import Chance, Noise, evidence
from matching.engine.field import Fields, Scene, distinct, explained, rigid, rigid_state
from matching.engine.field_loops import SIGMA_SCORE
from matching.engine.guided_field import guided
from matching.engine.hypotheses import LAST_SIGMAS, polished, scene_of
from matching.engine.plan_walls import PlanWalls

SURE = float(np.log(199))  # nats
NOISE = Noise(
    np.array([SIGMA_ACROSS]), np.array([(SIGMA_END, 1 - USUAL.missing, USUAL.missing / 2, USUAL.missing / 2)])
)


@dataclass(frozen=True)
class Symmetry:
    """Another place that explains the map.

    `T_a_s` is (yaw, x, y) in rad and m, `floor` the A floor's id, `nats` the expected evidence for the truth over it.
    """

    T_a_s: tuple[float, float, float]
    floor: str | None
    nats: float


def symmetries(seen: SceneGraph, plan: PlanWalls) -> list[Symmetry]:
    """Returns the symmetries of a perfect map's place, those hardest to tell from it first.

    `seen` are rooms of one storey of the plan, with their walls, in the plan's frame and with its ids; they move as
    one. The symmetries are distinct in the same sense as the hypotheses of a match.
    """
    if not seen.wall_surfaces:
        return []
    scene = scene_of(seen, plan, rigid=True)
    truth = guided(scene, _at_home(scene))
    places = alternative_placements(scene, truth.fields, truth.table[0])
    if not len(places):
        return []
    placed = polished(scene, guided(scene, places), LAST_SIGMAS)
    storey = np.concatenate((truth.fields.storey, placed.fields.storey))
    fields = Fields(storey, np.concatenate((truth.fields.state, placed.fields.state)))
    table = np.concatenate((truth.table, placed.table))
    score = evidence(scene, fields, table, Chance.of(scene, fields, table), NOISE).total
    nats = score[0] - score
    near = rigid(scene, fields, explained(scene, table, fields.state, SIGMA_SCORE))
    order = np.array([0, *(1 + np.argsort(nats[1:], kind="stable"))])
    order = order[distinct(storey[order], near[order])][1:]
    found = []
    for k in order[nats[order] < SURE].tolist():
        there = plan.storeys[int(storey[k])]
        yaw, x, y = between_graphs(scene.s, there, near[k]).tolist()
        found.append(Symmetry((yaw, x, y), there.floor, max(float(nats[k]), 0.0)))
    return found


def _at_home(scene: Scene) -> Fields:
    """The map where it is."""
    home = next(k for k, storey in enumerate(scene.plan.storeys) if scene.s.ids[0] in storey.ids)
    motion = se2.compose(se2.inverse(scene.plan.storeys[home].T_graph_own), scene.s.T_graph_own)
    return Fields(np.array([home]), rigid_state(scene, motion[None]))


@dataclass(frozen=True)
class SimilarPlace:
    """Another place that a map of `rooms` fits: on storey `floor`, after a rotation by `rotation` (rad).

    `counterparts` are the rooms that lie there, one for each of `rooms`, None where there is none. `nats` is the
    expected evidence against the place.
    """

    rooms: tuple[str, ...]
    floor: str | None
    counterparts: tuple[str | None, ...]
    rotation: float
    nats: float


class SelfSimilarity:
    """Finds and caches the symmetries of perfect maps of an A-graph's rooms."""

    def __init__(self, a: SceneGraph) -> None:
        self._a, self._plan = a, PlanWalls.of(a)
        self._cache: dict[frozenset[str], list[Symmetry]] = {}
        self._storeys = {s.floor: s for s in storeys_of(a)}

    def symmetries(self, rooms: Collection[str]) -> list[Symmetry]:
        """The other placements of a perfect map of these rooms, which lie on one storey."""
        key = frozenset(rooms)
        if key not in self._cache:
            seen = perfect_map(self._a, key).s_graph
            self._cache[key] = [] if self._plan is None else symmetries(seen, self._plan)
        return self._cache[key]

    def similar_places(self, rooms: Collection[str]) -> list[SimilarPlace]:
        """The same placements with the rooms that lie there, the most similar first."""
        own = [r for r in self._a.rooms if r.id in rooms]
        found = []
        for placement in self.symmetries(rooms):
            storey = self._storeys.get(placement.floor)  # None where no room has walls, as among foundations
            centroids = se2.apply(np.array(placement.T_a_s), np.array([r.centroid for r in own]))
            counterparts = tuple(None if storey is None else _room_at(storey, point) for point in centroids)
            rotation = float(se2.wrap(np.array([placement.T_a_s[0]]))[0])
            ids = tuple(r.id for r in own)
            found.append(SimilarPlace(ids, placement.floor, counterparts, rotation, placement.nats))
        return found


def _room_at(storey: Storey, point: np.ndarray) -> str | None:
    return next((r.id for k, r in enumerate(storey.rooms) if storey.holds(k, point[None])), None)
