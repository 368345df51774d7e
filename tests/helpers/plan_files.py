"""One building in every form in which plans are read: a hall with a core, a gate, columns, and walls outdoors.

y 11  +----------------+-----+
   |  |                | core|     the hall is open at a gate in the south; a layer of a wall stands 0.4 m before
   |  |   o      o     +--- -+     the hall in the west, a fence in the yard in the east; o are columns
layer |   o      o           |  fence
y 0   +-----  gate  ---------+
      x 0                    16
"""

import json
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry import mapping

from data.generation.level_building import extruded
from data.geometry.areas import difference, united
from data.ifc.writer import IfcWriter, Prism, box
from data.plans.bim import load_bim
from data.plans.mesh_plan import read_mesh
from data.scene_graph import SceneGraph

X, Y, T, TOP = 16.0, 11.0, 0.3, 2.8
CORE = shapely.box(X - 5, Y - 4, X - T, Y - T)  # the only room of the plan
COLUMNS = [shapely.box(x - 0.2, y - 0.2, x + 0.2, y + 0.2) for x in (4.0, 9.0) for y in (3.0, 6.5)]
FENCE, LAYER = shapely.box(X + 3, 1, X + 3.2, 7), shapely.box(-0.7, 1, -0.4, 9)
DOOR = shapely.box(X - 4, Y - 4.2, X - 3, Y - 4)
FAR = (4_000_000.0, 5_500_000.0)  # where the block of a drawing stands
Walls = shapely.MultiPolygon


def hall(gate: float = 4.0) -> Walls:
    """The walls, with the door's opening."""
    outer = shapely.box(0, 0, X, Y)
    ring = difference(outer, outer.buffer(-T, join_style="mitre"))
    core = difference(shapely.box(X - 5.2, Y - 4.2, X, Y), CORE)
    return difference(united([ring, core, *COLUMNS, FENCE, LAYER]), united([shapely.box(5, -1, 5 + gate, 1), DOOR]))


def rings(walls: Walls) -> list[list[tuple[float, float]]]:
    """All outlines and holes, closed."""
    return [list(r.coords) for p in shapely.get_parts(walls) for r in (p.exterior, *p.interiors)]


def feature(shape: Any, **properties: Any) -> dict[str, Any]:
    """A feature of GeoJSON."""
    return {"type": "Feature", "geometry": mapping(shape), "properties": properties}


def geojson(path: Path, features: list[dict[str, Any]]) -> Path:
    """A collection of features."""
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def _geojson(path: Path, walls: Walls, rooms: bool = False, lines: bool = False) -> Path:
    parts = [shapely.LineString(ring) for ring in rings(walls)] if lines else shapely.get_parts(walls)
    features = [feature(p, kind="wall") for p in parts] + [feature(DOOR, type="door")]
    return geojson(path, [*features, *[feature(CORE, element="room", name="Core")] * rooms])


def _floor_plan(path: Path, walls: Walls) -> Path:
    elements = {"wall": [{"polygon": mapping(walls)}], "door": [{"polygon": mapping(DOOR)}]}
    rooms = [{"type": "store", "polygon": mapping(CORE)}]
    path.write_text(json.dumps({"unit": "m", "rooms": rooms, "elements": elements}))
    return path


def new_drawing(units: int = 6, metric: int = 1) -> Any:
    """A DXF drawing; `units` as in $INSUNITS, 0 for none."""
    import ezdxf

    drawing = ezdxf.new("R2010")
    drawing.header["$MEASUREMENT"], drawing.header["$INSUNITS"] = metric, units
    return drawing


def dxf(path: Path, walls: Walls, draw: str, layer: str = "A-WALL", unit: float = 1.0, drawing: Any = None) -> Path:
    """The walls as `outlines`, `hatches`, `lines`, or as a hatch in a `block` within a block, turned there and back."""
    drawing = drawing or new_drawing()
    into, attributes = drawing.modelspace(), {"layer": layer}
    if draw == "block":
        house, into = drawing.blocks.new("HOUSE"), drawing.blocks.new("INNER")
        house.add_blockref("INNER", (0, 0), dxfattribs={"rotation": -30, "layer": "0"})
        drawing.modelspace().add_blockref("HOUSE", FAR, dxfattribs={"rotation": 30, "layer": layer})
        attributes = {"layer": "0"}
    hatch = into.add_hatch(dxfattribs=attributes) if draw in ("hatches", "block") else None
    for ring in ((np.array(ring) / unit).tolist() for ring in rings(walls)):
        if hatch is not None:
            hatch.paths.add_polyline_path(ring[:-1], is_closed=True)
        elif draw == "outlines":
            into.add_lwpolyline(ring[:-1], close=True, dxfattribs=attributes)
        else:
            for a, b in pairwise(ring):
                into.add_line(a, b, dxfattribs=attributes)
    drawing.saveas(path)
    return path


def _ifc(path: Path, walls: Walls, rooms: bool = False) -> Path:
    writer = IfcWriter.begun("hall", {"Ground": 0.0})
    for polygon in shapely.get_parts(walls):
        pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
        body = [Prism(tuple(p.exterior.coords[:-1]), 0.0, TOP) for p in pieces]
        writer.element("IfcColumn" if polygon.area < 0.2 else "IfcWall", "", "Ground", body)
    if rooms:
        x0, y0, x1, y1 = CORE.bounds
        writer.space("Core", "Ground", box(x0, y0, 0.0, x1, y1, TOP))
    writer.save(path)
    return path


def _mesh(path: Path, walls: Walls) -> Path:
    import trimesh

    floor, lintel = extruded(shapely.box(0, 0, X, Y), -0.2, 0.0), extruded(DOOR, 2.1, TOP)
    triangles = np.concatenate([floor, lintel, extruded(walls, 0.0, TOP)])
    trimesh.Trimesh(**trimesh.triangles.to_kwargs(triangles)).export(path)
    return path


PLANS: dict[str, Callable[[Path, Walls], Path]] = {
    "geojson": lambda f, w: _geojson(f / "a.geojson", w),
    "geojson lines": lambda f, w: _geojson(f / "b.geojson", w, lines=True),
    "geojson with rooms": lambda f, w: _geojson(f / "c.geojson", w, rooms=True),
    "floor plan": lambda f, w: _floor_plan(f / "plan.json", w),
    "dxf outlines": lambda f, w: dxf(f / "a.dxf", w, "outlines"),
    "dxf hatches": lambda f, w: dxf(f / "b.dxf", w, "hatches"),
    "dxf lines": lambda f, w: dxf(f / "c.dxf", w, "lines"),
    "dxf block": lambda f, w: dxf(f / "d.dxf", w, "block"),
    "ifc": lambda f, w: _ifc(f / "a.ifc", w),
    "ifc with rooms": lambda f, w: _ifc(f / "b.ifc", w, rooms=True),
    "mesh": lambda f, w: _mesh(f / "a.stl", w),
}


def read_plan(path: Path) -> SceneGraph:
    """The A-graph of any of them."""
    return read_mesh(path).graph if path.suffix == ".stl" else load_bim(path).graph
