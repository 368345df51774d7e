"""Verdicts on the walls, a door and a slab of the upper storey of `report_samples.building`."""

from dataclasses import asdict
from typing import Any

import numpy as np

from data.scene_graph import SceneGraph, WallSurface
from sgslam.as_built.elements import ElementVerdict, Verdict

NAMELESS = "2nameless00000000000Wa"
_DEPTH = 0.2  # m


def verdict(global_id: str, name: str, told: Verdict, wall: WallSurface, offset: float | None = None, **more: Any
            ) -> ElementVerdict:  # fmt: skip
    """A wall behind a planned surface, on the upper storey, measured with a sigma of 5 mm where it has an offset."""
    known = offset is not None
    n, half = np.array(wall.normal), (wall.length or 1.0) / 2
    along = np.array([-n[1], n[0]])
    corners = [np.array(wall.centroid) + s * half * along - d * n for s, d in
               ((-1, 0.0), (1, 0.0), (1, _DEPTH), (-1, _DEPTH))]  # fmt: skip
    outline = tuple((float(x), float(y)) for x, y in corners)
    told_of = {
        "ifc_class": "IfcWallStandardCase", "storey": "Storey 1", "rooms": ("Corridor",), "verdict": told,
        "offset_m": offset, "direction": (0.0, 1.0, 0.0) if known else None, "sigma_m": 0.005 if known else None,
        "loa": "LOA30" if known else None, "conclusive": told != "uncertain", "turn_rad": 0.0005 if known else None,
        "turn_sigma_rad": 0.0008 if known else None, "din_18202_limit_m": 0.012 if known else None,
        "din_18202": "kept" if known else None, "seen": 0.0 if told == "not seen" else 0.85, "views": 7,
        "reason": f"because it is {told}", "outline": outline,
    }  # fmt: skip
    return ElementVerdict(global_id, name, **(told_of | more))


def verdicts(a_graph: SceneGraph) -> list[ElementVerdict]:
    """Twelve elements, of which eight were seen: in the building's order, not in that of the report."""
    walls = [w for w in a_graph.wall_surfaces if w.floor == "F1"]
    found = [verdict(f"{k:022d}", f"Wall {k}", "as planned", walls[k], 0.001 * k) for k in range(4)]
    found += [
        verdict("guid-absent", "Wall 12", "absent", walls[4]),
        verdict("1moved000000000000Wall", "Wall 30", "moved", walls[5], -0.1234, din_18202="exceeded"),
        verdict(NAMELESS, " ", "moved", walls[6], 0.045),
        verdict("3door0000000000000Door", "Door 7", "uncertain", walls[7], ifc_class="IfcDoor"),
        *(verdict(f"4hidden00000000000000{k}", f"Wall 4{k}", "not seen", walls[8 + k]) for k in range(3)),
        verdict("5slab0000000000000Slab", "Slab", "not seen", walls[11], ifc_class="IfcSlab"),
    ]
    return found


def entries(a_graph: SceneGraph) -> list[dict[str, Any]]:
    """As elements.json has them."""
    return [asdict(found) for found in verdicts(a_graph)]
