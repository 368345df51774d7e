"""An immutable snapshot of a run between two scans, for viewers."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from data.scene_graph import SceneGraph
from sgslam.mapping import KeyframeClouds

if TYPE_CHECKING:
    from sgslam.session.active_map import ActiveMap

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The state of a run at one moment.

    `stamps_ns` (K,), `poses` (K, 4, 4) T_map_sensor and `floors` (K,) floor ids (None on a stair) are those of the
    keyframes. `graphs` are the S-graph's floors in the map frame, as of their last update; without a plan, which would
    have rooms segmented, they are segmented for this. `plan` is the graph that
    the map is matched with; `T_plan_map` (4, 4) is None until it is placed there. `matches` has the form of
    matches.json, None until the map is placed; until then `hypotheses` are the matcher's: (floor id, hypothesis as in
    matches.json).
    """

    stamps_ns: NDArray[np.int64]
    poses: Floats
    floors: tuple[str | None, ...]
    graphs: tuple[SceneGraph, ...]
    plan: SceneGraph | None
    T_plan_map: Floats | None
    matches: dict[str, Any] | None
    hypotheses: tuple[tuple[str, Mapping[str, Any]], ...]
    reason: str
    clouds: KeyframeClouds

    @staticmethod
    def of(active: "ActiveMap") -> "Snapshot":
        """Of a map, between two scans. Takes a few milliseconds, some tens without a plan, and changes nothing."""
        keyframes, T_map_local, anchoring = active.backend.keyframes, active.backend.T_map_local, active.anchoring
        matches, hypotheses = None, []
        known = [floor.scene for floor in active.floors.maps if floor.scene is not None]
        if anchoring is not None and T_map_local is not None:
            matches = anchoring.answer(active.floors, anchoring.alignments(active.floors, T_map_local))
        elif anchoring is not None:
            for number, match in anchoring.newest_matches.items():
                hypotheses += [(f"floor-{number}", found) for found in match.to_dict().get("hypotheses") or ()]
        return Snapshot(
            stamps_ns=np.array([k.stamp_ns for k in keyframes], dtype=np.int64),
            poses=active.backend.poses,
            floors=tuple(None if k.storey is None else f"floor-{k.storey}" for k in keyframes),
            graphs=tuple(scene.graph for scene in (active.scenes_now() if anchoring is None else known)),
            plan=None if anchoring is None else anchoring.a_graph,
            T_plan_map=active.T_plan_map,
            matches=matches,
            hypotheses=tuple(hypotheses),
            reason="" if anchoring is None else anchoring.reason,
            clouds=active.clouds,
        )

    def pairs(self, kind: str) -> dict[str, str]:
        """A-graph ids by S-graph ids; `kind` is `rooms` or `wall_surfaces`. Empty until the map is placed."""
        matched = (self.matches or {}).get(kind) or () if self.T_plan_map is not None else ()
        return {s_id: a_id for s_id, a_id, _ in matched}

    @property
    def storeys(self) -> dict[str, str]:
        """The plan's storey id of each floor id of the map whose storey is known."""
        if self.T_plan_map is None:
            return {}
        matches = self.matches or {}
        sole = matches.get("floor")
        known = matches.get("floors") or {graph.floors[0].id: sole for graph in self.graphs if graph.floors}
        return {floor: storey for floor, storey in known.items() if storey is not None}
