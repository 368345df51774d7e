"""The elements of an IFC model that are compared with the building: walls, columns, slabs, ceilings, doors, windows."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from threading import Lock

import ifcopenshell
import numpy as np
from ifcopenshell.util.element import get_container
from ifcopenshell.util.placement import get_local_placement
from ifcopenshell.util.unit import calculate_unit_scale
from numpy.typing import NDArray

from data.ifc.doors import FILLINGS
from data.ifc.products import open_ifc, opening_of, products, triangulated
from data.plans.bodies import PANE, PlannedElement

_ONE_AT_A_TIME = Lock()
SOLID = ("IfcWall", "IfcColumn", "IfcSlab", "IfcCovering", "IfcCurtainWall")
Floats = NDArray[np.float64]
NEAR = 0.5  # m from a line up to which an element stands on it


def planned_elements(ifc: Path | str) -> tuple[PlannedElement, ...]:
    """The elements of a model, with what has no geometry left out. Raises UserError as `open_ifc` does.

    Those of the last model are kept; another thread may have asked for them already, which then is waited for.
    """
    path = Path(ifc)
    with _ONE_AT_A_TIME:
        return _planned_elements(path, path.stat().st_mtime_ns if path.is_file() else 0)


@lru_cache(1)
def _planned_elements(ifc: Path, mtime_ns: int) -> tuple[PlannedElement, ...]:
    model = open_ifc(ifc)
    storeys = {storey.GlobalId: storey.Name or storey.GlobalId for storey in model.by_type("IfcBuildingStorey")}
    found = []
    for p in products(model, SOLID):
        storey, pane = storeys.get(p.storey or "", ""), PANE if p.ifc_class == "IfcCurtainWall" else 0.0
        found.append(PlannedElement(p.global_id, p.ifc_class, p.name, storey, "solid", p.triangles, pane=pane))
    families = grid_families(model)
    return tuple(
        replace(element, grid=grid_reference(families, element.triangles.reshape(-1, 3)[:, :2]))
        for element in (*found, *_openings(model, storeys))
    )


def _openings(model: ifcopenshell.file, storeys: dict[str, str]) -> Iterator[PlannedElement]:
    """The openings that doors and windows fill."""
    for filling in dict.fromkeys(entity for kind in FILLINGS for entity in model.by_type(kind)):
        body, wall = opening_of(filling)
        if body is None:
            continue
        container, own = get_container(filling), triangulated(filling)
        storey = storeys.get(container.GlobalId, "") if container is not None else ""
        yield PlannedElement(
            filling.GlobalId, filling.is_a(), filling.Name or "", storey, "opening", body[0][body[1]], wall=wall or "",
            filling=None if own is None else own[0][own[1]],
        )  # fmt: skip


def other_bodies(ifc: Path | str) -> NDArray[np.float64]:
    """(M, 3, 3) the triangles, metres in the BIM frame, of all that the model has besides `planned_elements`: stairs,
    railings, beams, furniture. Raises UserError as `open_ifc` does."""
    model = open_ifc(ifc)
    known = (*SOLID, *FILLINGS, "IfcFeatureElement", "IfcVirtualElement", "IfcGeographicElement")
    others = sorted({e.is_a() for e in model.by_type("IfcElement") if not any(e.is_a(c) for c in known)})
    bodies = [product.triangles for product in products(model, tuple(others))]
    return np.concatenate(bodies or [np.empty((0, 3, 3))])


@dataclass(frozen=True, eq=False)
class GridLine:
    """A straight line with its tag: two points (2, 2) in plan view, BIM frame, metres."""

    tag: str
    ends: Floats

    def offsets(self, places: Floats) -> Floats:
        """(N,) the signed distances (m) of places (N, 2), positive to the left."""
        along = self.ends[1] - self.ends[0]
        away = places - self.ends[0]
        return np.asarray((along[0] * away[:, 1] - along[1] * away[:, 0]) / np.linalg.norm(along))


Family = Sequence[GridLine]  # lines that go the same way


def grid_families(model: ifcopenshell.file) -> list[Family]:
    """The lines of all grids by the families U, V and W of each; curved ones are left out."""
    metre = calculate_unit_scale(model)
    families: list[Family] = []
    for grid in model.by_type("IfcGrid"):
        T = get_local_placement(grid.ObjectPlacement) if grid.ObjectPlacement is not None else np.eye(4)
        for axes in (grid.UAxes, grid.VAxes, grid.WAxes):
            lines = [line for axis in axes or () if (line := _line(axis, T, metre)) is not None]
            if lines:
                families.append(_same_way(lines))
    return families


def grid_reference(families: Sequence[Family], outline: Floats) -> str:
    """Where an outline (N, 2) stands, such as `B/3`; `A-C/3` for one that reaches from A to C or stands between them.
    Empty without grid lines."""
    return "/".join(_within(family, outline) for family in families)


def _within(family: Family, outline: Floats) -> str:
    """The tags of the lines on which the outline stands, else of those next to it, in the model's order."""
    offsets = [line.offsets(outline) for line in family]
    spans = [(float(own.min()), float(own.max()), k) for k, own in enumerate(offsets)]
    on = [k for low, high, k in spans if low <= NEAR and high >= -NEAR]
    if not on:
        left = [(low, k) for low, _, k in spans if low > NEAR]
        right = [(-high, k) for _, high, k in spans if high < -NEAR]
        on = [min(beside)[1] for beside in (left, right) if beside]
    first, last = min(on), max(on)
    return family[first].tag if first == last else f"{family[first].tag}-{family[last].tag}"


def _same_way(lines: list[GridLine]) -> list[GridLine]:
    """The lines, all turned as the first one."""
    first = lines[0].ends[1] - lines[0].ends[0]
    return [
        line if (line.ends[1] - line.ends[0]) @ first >= 0 else GridLine(line.tag, line.ends[::-1]) for line in lines
    ]


def _line(axis: ifcopenshell.entity_instance, T: Floats, metre: float) -> GridLine | None:
    """`T` is the grid's placement in the model's unit."""
    points = list(_points(axis.AxisCurve))
    if len(points) != 2:
        return None
    placed = np.array([[*point[:2], 0.0, 1.0] for point in points]) @ T.T
    ends = placed[:, :2] * metre
    return GridLine(axis.AxisTag or "?", ends) if np.linalg.norm(ends[1] - ends[0]) > 0 else None


def _points(curve: ifcopenshell.entity_instance) -> Iterator[Sequence[float]]:
    """The two ends of a straight curve; none of another."""
    if curve.is_a("IfcPolyline") and len(curve.Points) == 2:
        yield from (point.Coordinates for point in curve.Points)
    elif curve.is_a("IfcIndexedPolyCurve") and len(curve.Points.CoordList) == 2:
        yield from curve.Points.CoordList
    elif curve.is_a("IfcTrimmedCurve") and curve.BasisCurve.is_a("IfcLine"):
        trims = [end for trim in (curve.Trim1, curve.Trim2) for end in trim if end.is_a("IfcCartesianPoint")]
        yield from (point.Coordinates for point in trims)
    elif curve.is_a("IfcLine"):
        start, towards = np.array(curve.Pnt.Coordinates[:2]), np.array(curve.Dir.Orientation.DirectionRatios[:2])
        yield from (start.tolist(), (start + towards * curve.Dir.Magnitude).tolist())
