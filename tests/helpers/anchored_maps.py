"""The map of the small drive, on one floor or two, and what becomes of it in plans of one storey or more."""

from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np
from boxes import Array
from drives import small_run

from data import SceneGraph, WallSurface
from matching import Matcher, MatchResult
from sgslam.anchoring.building_anchoring import BuildingAnchoring
from sgslam.config import AnchorSettings, Config
from sgslam.geometry.frames import inverse
from sgslam.mapping import Anchors, Floors

HIGHER = 3.0  # m from storey to storey
CONFIG = Config()


@dataclass
class CountingMatcher:
    """The default one; `asked` are the numbers of walls of the maps that it got."""

    asked: list[int] = field(default_factory=list)

    def match(self, s: SceneGraph, a: SceneGraph) -> MatchResult:
        self.asked.append(len(s.wall_surfaces))
        return Matcher.load().match(s, a)


def ground() -> SceneGraph:
    """The plan of the building."""
    return _mapped()[0]


def storeys(*moved: float) -> SceneGraph:
    """The plan with more storeys above: of the same rooms, with every third wall moved by so many metres."""
    below = ground()
    plan = replace(below, doors=())
    (floor,) = below.floors
    for number, metres in enumerate(moved, 1):
        up, name = number * HIGHER, f"storey {number}"
        walls = tuple(_raised(w, up, name, metres * (k % 3 == 0)) for k, w in enumerate(below.wall_surfaces))
        plan = replace(
            plan,
            floors=(*plan.floors, replace(floor, id=name, name=name, elevation=(floor.elevation or 0.0) + up)),
            rooms=plan.rooms + tuple(replace(r, id=r.id + name, floor=name) for r in below.rooms),
            wall_surfaces=plan.wall_surfaces + walls,
        )
    return plan


def _raised(wall: WallSurface, up: float, name: str, moved: float) -> WallSurface:
    x, y = (np.array(wall.centroid) + moved * np.array(wall.normal)).tolist()
    height = wall.height and (wall.height[0] + up, wall.height[1] + up)
    room = wall.room and wall.room + name
    return replace(wall, id=wall.id + name, room=room, floor=name, centroid=(x, y), height=height, plane=None)


def _mapped() -> tuple[SceneGraph, Floors, Array]:
    """The plan, its map, and the place of the plan's local frame in the map."""
    slam, _ = small_run(with_bim=True)
    final, anchoring = slam._map, slam._map.anchoring
    assert anchoring is not None and final.backend.T_map_local is not None
    return anchoring.a_graph, final.floors, final.backend.T_map_local


def two_floors(apart: float = HIGHER) -> Floors:
    """The map, and the same rooms once more on a floor that is higher by so many metres."""
    both, below = Floors(CONFIG), _mapped()[1].maps[0]
    walls = copy(below.walls)
    walls.T_level_map = below.walls.T_level_map.copy()
    walls.T_level_map[2, 3] -= apart
    both.maps = [copy(below), replace(below, number=1, walls=walls)]
    return both


class Anchored:
    """The map in a plan; `T_map_local` is the true place, as a back end has it."""

    def __init__(
        self,
        plan: SceneGraph | None = None,
        floors: Floors | None = None,
        start: str | None = None,
        matcher: Matcher | None = None,
        **anchors: float,
    ) -> None:
        below, floor, T_map_local = _mapped()
        self.floors, self.matcher = floors or copy(floor), CountingMatcher()
        config = Config(anchors=AnchorSettings(**anchors))  # type: ignore[arg-type]
        self.anchoring = BuildingAnchoring(plan or below, matcher or self.matcher, config, start)
        T_local_map = inverse(T_map_local)
        T_local_map[:3, 3] += BuildingAnchoring(below, self.matcher, CONFIG).origin - self.anchoring.origin
        self.T_map_local: Array | None = inverse(T_local_map)

    def update(self, last: bool = True) -> Anchors | None:
        return self.anchoring.update(self.floors, self.T_map_local, last)

    @property
    def asked(self) -> int:
        """How often the default matcher was asked."""
        return len(self.matcher.asked)

    @property
    def storeys(self) -> list[str | None]:
        """Where the lower and the upper floor are."""
        committed = [self.anchoring.of(number).committed for number in (0, 1)]
        return [None if match is None else match.floor for match in committed]

    def answer(self, *numbers: int) -> dict:
        """What matches.json says, by the walls of these floors, all without numbers."""
        aligned = self.anchoring.alignments(self.floors, self.T_map_local)
        found = self.anchoring.answer(self.floors, {n: a for n, a in aligned.items() if not numbers or n in numbers})
        assert found is not None
        return found
