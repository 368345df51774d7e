"""Maps by SLAM with their true places in plans, from the files of `python -m evaluation.maps`."""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from data.common.errors import UserError
from data.common.files import write_json
from data.plans.bim import split_of
from data.scene_graph import SceneGraph, WallSurface
from matching.engine.hypotheses import Hypotheses, scene_of, search
from matching.engine.plan_walls import PlanWalls
from matching.engine.verdict import Signs, ranked
from matching.training.truth import is_near, thinned

# the map's own plan, without some of its walls, with walls that were not built, and another's
REGIMES = ("whole", "thinned", "extended", "foreign")
NOT_BUILT = 3  # walls, at most
WALL_M = 0.12  # their thickness


@dataclass(frozen=True)
class MapInPlan:
    """A map by SLAM: its S-graph, of the file `plan`; its true place and storey there."""

    building: str
    s_graph: SceneGraph
    plan: str
    T_a_s: tuple[float, float, float]
    floor: str | None

    def save(self, path: Path) -> None:
        """Writes the map as JSON; `plan` is beside it."""
        write_json(path, {**asdict(replace(self, s_graph=None)), "s_graph": self.s_graph.to_dict()})  # type: ignore[arg-type]

    @staticmethod
    def load(path: Path) -> "MapInPlan":
        """Reads a map. Raises UserError."""
        try:
            stored: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
            place = stored["T_a_s"][0], stored["T_a_s"][1], stored["T_a_s"][2]
            graph = SceneGraph.from_dict(stored["s_graph"])
            return MapInPlan(stored["building"], graph, stored["plan"], place, stored["floor"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise UserError(f"{path}: no map of python -m evaluation.maps ({error!r})") from None

    def right(self, found: Hypotheses, regime: str) -> list[bool]:
        """Whether each hypothesis on the map is right."""
        if regime == "foreign":
            return [False] * len(found)
        return is_near(found, self.s_graph, np.array(self.T_a_s), self.floor)


def placed_maps(folder: Path, rng: np.random.Generator) -> Iterator[tuple[MapInPlan, str, Hypotheses, Signs]]:
    """Each map of a folder in the plans of all `REGIMES`, with what is found there, if anything is.

    Raises UserError as `MapInPlan.load` does, and if there is no map, or maps of one building alone.
    """
    maps = [MapInPlan.load(path) for path in sorted(folder.glob("*.map.json"))]
    plans = {name: SceneGraph.load(folder / name) for name in sorted({m.plan for m in maps})}
    building = {m.plan: m.building for m in maps}
    if len(set(building.values())) < 2:
        raise UserError(f"{folder}: no maps of several buildings; python -m evaluation.maps writes them")
    for m in maps:
        others = [plan for plan, name in building.items() if name != m.building]
        # a plan that training sees must not be met again in validation
        others = [plan for plan in others if split_of(building[plan]) == split_of(m.building)] or others
        for regime in REGIMES:
            plan = plans[m.plan if regime != "foreign" else str(rng.choice(others))]
            plan = thinned(plan, rng) if regime == "thinned" else extended(plan, rng) if regime == "extended" else plan
            found = searched(m.s_graph, plan)
            if found is not None:
                yield m, regime, *found


def extended(plan: SceneGraph, rng: np.random.Generator) -> SceneGraph:
    """The plan with some walls more, both sides of each, through rooms: they were not built."""
    more: list[WallSurface] = []
    for n in range(int(rng.integers(1, NOT_BUILT + 1))):
        room = plan.rooms[int(rng.integers(len(plan.rooms)))]
        like = plan.wall_surfaces[int(rng.integers(len(plan.wall_surfaces)))]
        place = np.array(room.centroid) + rng.uniform(-1, 1, 2)
        for side in (1, -1):
            normal = side * np.array(like.normal)
            x, y = (place + WALL_M / 2 * normal).tolist()
            named = replace(like, id=f"not-built-{n}-{side}", room=room.id, floor=room.floor, parts=())
            more.append(replace(named, centroid=(x, y), normal=(float(normal[0]), float(normal[1]))))
    return replace(plan, wall_surfaces=(*plan.wall_surfaces, *more))


def searched(s: SceneGraph, plan: SceneGraph) -> tuple[Hypotheses, Signs] | None:
    """The hypotheses on a map in a plan, the likeliest first, with their signs; None if there are none."""
    walls = PlanWalls.of(plan)
    found = None if walls is None or not s.wall_surfaces else search(scene_of(s, walls))
    return ranked(found) if found is not None and len(found) else None
