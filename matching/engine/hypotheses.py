"""Searches for distinct hypotheses, each a field of motions over the map.

Corners vote for motions of parts of the map (`seeds`). Each grows from its part over the neighbouring rooms (`grow`).
A room's walls are used as soon as one of its neighbours is placed. Every field is scored by its evidence (`evidence`).
Places where the plan looks like the best one are added (`alternative_placements`), so that a symmetric place is found
even if it got few votes.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from data.geometry import se2
from data.geometry.se2 import Array
from data.scene_graph import SceneGraph
from matching.arrays import Index, arrays
from matching.arrays.groups import groups
from matching.arrays.walls import between_graphs, doors
from matching.engine.alternatives import alternative_placements
from matching.engine.evidence import Chance, evidence
from matching.engine.field import Fields, Scene, distinct, explained, motions, rigid
from matching.engine.field_loops import SIGMA_SCORE
from matching.engine.guided_field import GuidedFields, advance, guided, restart_locally
from matching.engine.plan_walls import PlanWalls
from matching.engine.seeds import seeds

SIGMAS = np.array([0.35, 0.25, 0.18, 0.13])  # metres across; decreasing as a group's walls settle
LAST_SIGMAS = np.array([0.25, 0.18, 0.13, 0.13])
SEEDS = 14
DOUBTFUL = 150  # walls of a map times the seeds that are always tried
WALLS = 2000  # of a map times the hypotheses that are refined: large maps are less ambiguous
HOPEFUL, ALTERNATIVES = 0.5, 2  # share of what the best field explains; weaker ones are dropped, but a few always stay
FOLLOWED = 8  # fields that are refined and scored, at most
MOST_STEPS = 30  # of growth; larger maps grow by several rooms a step


@dataclass(frozen=True)
class Hypotheses:
    """K distinct hypotheses, best first.

    `fields` are the motions of the map's groups, `table` (K, Ns, P) the candidate A walls of each S wall, -1 for none.
    `score` (K,) is the evidence in nats. `rigid` (K, 3) is
    the rigid motion (yaw, x, y) nearest to each field, between the graphs' own frames.
    """

    scene: Scene
    fields: Fields
    table: Index
    score: Array
    rigid: Array

    def __len__(self) -> int:
        return len(self.score)

    def __getitem__(self, chosen: Index) -> "Hypotheses":
        of = self.fields[chosen], self.table[chosen], self.score[chosen], self.rigid[chosen]
        return Hypotheses(self.scene, *of)

    @cached_property
    def between_graphs(self) -> Array:
        """(K, 3) the nearest rigid motions T_a_s (yaw, x, y), between the graphs' frames."""
        storeys = self.scene.plan.storeys
        own = np.array([storeys[k].T_graph_own for k in self.fields.storey.tolist()]).reshape(-1, 3)
        return se2.compose(se2.compose(own, self.rigid), se2.inverse(self.scene.s.T_graph_own))


def scene_of(s: SceneGraph, plan: PlanWalls, rigid: bool = False) -> Scene:
    """Returns the scene of a map with at least one wall surface and a plan; a `rigid` map moves as one."""
    walls = arrays(s, None, list(s.wall_surfaces))
    own = doors(s, walls)
    return Scene(walls, groups(walls, own, rigid), plan, own)


def search(scene: Scene, allowed: Callable[[Array], bool] | None = None) -> Hypotheses:
    """Returns distinct hypotheses, best first; none if nothing votes for a motion.

    `allowed` says for T_a_s (3,), between the graphs' frames, whether a placement is allowed.
    """
    s = scene.s
    fewest, most = (min(max(w // len(s), least), SEEDS) for w, least in ((DOUBTFUL, 2), (WALLS, 4)))
    fields, sure = seeds(scene, fewest, most)
    fields, sure = _allowed(scene, fields, sure, allowed)
    if not len(fields):
        return Hypotheses(scene, fields, np.zeros((0, len(s), 0), dtype=np.int64), np.zeros(0), np.zeros((0, 3)))
    grown = grow(scene, fields, sure)
    chance = Chance.of(scene, grown.fields, grown.table)
    found = _scored(scene, grown, chance)
    more = alternative_placements(scene, found.fields[np.zeros(1, dtype=np.int64)], found.table[0])
    if len(more):
        found = _merged(found, _scored(scene, polished(scene, guided(scene, more), LAST_SIGMAS), chance))
    if allowed is None:
        return found
    kept = [k for k, T_a_s in enumerate(found.between_graphs) if allowed(T_a_s)]
    return found[np.array(kept, dtype=np.int64)]


def _allowed(
    scene: Scene, fields: Fields, sure: Index, allowed: Callable[[Array], bool] | None
) -> tuple[Fields, Index]:
    if allowed is None or not len(fields):
        return fields, sure
    near = motions(scene, fields.state)[:, 0]
    storeys = scene.plan.storeys
    kept = [k for k in range(len(near)) if allowed(between_graphs(scene.s, storeys[fields.storey[k]], near[k]))]
    chosen = np.array(kept, dtype=np.int64)
    return fields[chosen], sure[chosen]


def grow(scene: Scene, fields: Fields, sure: Index) -> GuidedFields:
    """Grows each field from its initial group over the map; those that explain most are refined."""
    hops = scene.groups.hops[sure]  # (K, G)
    pace = max(1, int(np.ceil(hops.max() / MOST_STEPS)))
    turn = -(-hops // pace)  # the step from which on a group's walls are used
    age = np.arange(1, int(turn.max()) + 1)[:, None, None] - turn
    sigmas = np.where(age >= 0, SIGMAS[np.minimum(np.maximum(age, 0), len(SIGMAS) - 1)], np.inf)
    grown = _followed(scene, advance(scene, guided(scene, fields), sigmas, search_every=4))
    grown = polished(scene, grown, SIGMAS[1:])
    restarted = GuidedFields(restart_locally(scene, grown.fields, grown.table), grown.seen, grown.table)
    return polished(scene, restarted, LAST_SIGMAS)


def _followed(scene: Scene, grown: GuidedFields) -> GuidedFields:
    """The fields that explain most and differ."""
    quality = explained(scene, grown.table, grown.fields.state, 0.3)
    worth = quality @ scene.s.weight
    best = np.argsort(-worth, kind="stable")
    best = best[distinct(grown.fields.storey[best], rigid(scene, grown.fields, quality)[best])]
    hopeful = worth[best] >= HOPEFUL * worth[best[0]]
    hopeful[:ALTERNATIVES] = True
    return grown[best[hopeful][: min(max(WALLS // len(scene.s), 3), FOLLOWED)]]


def polished(scene: Scene, begin: GuidedFields, sigmas: Array) -> GuidedFields:
    """Returns the fields after one step with each of the sigmas (T,), using all walls."""
    every = np.empty((len(sigmas), *begin.fields.state.shape[:2]))
    every[:] = sigmas[:, None, None]
    return advance(scene, begin, every)


def _scored(scene: Scene, grown: GuidedFields, chance: Chance) -> Hypotheses:
    fields, table = grown.fields, grown.table
    near = rigid(scene, fields, explained(scene, table, fields.state, SIGMA_SCORE))
    score = evidence(scene, fields, table, chance).total
    return _distinct(Hypotheses(scene, fields, table, score, near))


def _merged(one: Hypotheses, other: Hypotheses) -> Hypotheses:
    storey = np.concatenate((one.fields.storey, other.fields.storey))
    state = np.concatenate((one.fields.state, other.fields.state))
    table = np.concatenate((one.table, other.table))
    score, near = np.concatenate((one.score, other.score)), np.concatenate((one.rigid, other.rigid))
    return _distinct(Hypotheses(one.scene, Fields(storey, state), table, score, near))


def _distinct(found: Hypotheses) -> Hypotheses:
    """Those that differ from all better ones, best first."""
    found = found[np.argsort(-found.score, kind="stable")]
    return found[distinct(found.fields.storey, found.rigid)]
