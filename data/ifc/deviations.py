"""Writes a copy of an IFC model whose elements show how they were built: by a property set and a colour."""

import uuid
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

import ifcopenshell
import ifcopenshell.api.geometry
import ifcopenshell.guid
import numpy as np
from ifcopenshell.util.shape_builder import ShapeBuilder
from ifcopenshell.util.unit import calculate_unit_scale

from data.common.files import write_atomically
from data.ifc.products import open_ifc

Entity: TypeAlias = ifcopenshell.entity_instance
Status = Literal["as planned", "moved", "absent", "not seen", "uncertain"]
Rgb = tuple[float, float, float]
PROPERTY_SET = "AsBuilt"
COLORS: dict[str, tuple[Rgb, float]] = {  # and transparency; distinct to colour-blind eyes too
    "as planned": ((0.75, 0.82, 0.75), 0.0),
    "moved": ((0.84, 0.37, 0.0), 0.0),
    "absent": ((0.34, 0.71, 0.91), 0.6),
    "unplanned": ((0.8, 0.47, 0.65), 0.0),
}
_THICK = 0.02  # m, of the slab that shows the side of an unplanned wall


@dataclass(frozen=True)
class Measurement:
    """How well an element was measured: the level of accuracy `loa`, None where nothing was measured; whether it is
    `conclusive` of the status; the share of its surface that was `seen`, and from how many `views`."""

    loa: str | None
    conclusive: bool
    seen: float
    views: int


@dataclass(frozen=True)
class ElementFinding:
    """A finding on the element with this GlobalId.

    `shift_in_bim` (x, y, z) is its offset from the plan in metres, `sigma_m` the standard deviation of that, `turn_rad`
    its rotation in plan; `reason` explains the status.
    """

    global_id: str
    status: Status
    shift_in_bim: tuple[float, float, float] | None
    sigma_m: float | None
    turn_rad: float | None
    reason: str
    measurement: Measurement | None = None


@dataclass(frozen=True)
class UnplannedWall:
    """A side of a wall that the plan lacks: footprint from `start` to `end` (x y) and z from `low` to `high`, metres,
    the model's world coordinates; `storey` is the GlobalId of the storey that it stands on."""

    name: str
    start: tuple[float, float]
    end: tuple[float, float]
    low: float
    high: float
    storey: str | None
    reason: str


def write_as_built(
    ifc: Path | str, findings: list[ElementFinding], unplanned: list[UnplannedWall], path: Path | str
) -> int:
    """Writes the copy atomically, and returns how many of the findings are of products that are in the model.

    Lengths and angles are in the model's own units. Raises UserError for a file that cannot be read as IFC.
    """
    model = open_ifc(ifc)
    styles: dict[str, Entity] = {}
    marked = 0
    for finding in findings:
        try:
            element = model.by_guid(finding.global_id)
        except RuntimeError:
            continue
        marked += 1
        _describe(model, element, _properties(model, finding))
        _color(model, element, finding.status, styles)
    for wall_side in unplanned:
        proxy = _proxy(model, wall_side)
        _describe(model, proxy, {"Status": ("IfcLabel", "unplanned"), "Reason": ("IfcText", wall_side.reason)})
        _color(model, proxy, "unplanned", styles)
    write_atomically(path, model.to_string())
    return marked


def project_of(ifc: Path | str) -> str:
    """The GlobalId of a model's IfcProject, empty where it has none. Raises as `open_ifc` does."""
    return next((str(p.GlobalId) for p in open_ifc(ifc).by_type("IfcProject")), "")


def _properties(model: ifcopenshell.file, finding: ElementFinding) -> dict[str, tuple[str, Any]]:
    """Names to IFC types and values."""
    metre, radian = calculate_unit_scale(model), calculate_unit_scale(model, "PLANEANGLEUNIT")
    entries: dict[str, tuple[str, Any]] = {"Status": ("IfcLabel", finding.status)}
    if finding.shift_in_bim is not None:
        entries["Offset"] = "IfcLengthMeasure", float(np.linalg.norm(finding.shift_in_bim)) / metre
        for axis, shift in zip("XYZ", finding.shift_in_bim, strict=True):
            entries[f"Offset{axis}"] = "IfcLengthMeasure", shift / metre
    if finding.sigma_m is not None:
        entries["OffsetSigma"] = "IfcLengthMeasure", finding.sigma_m / metre
    if finding.turn_rad is not None:
        entries["Turn"] = "IfcPlaneAngleMeasure", finding.turn_rad / radian
    if finding.measurement is not None:
        entries |= _measured(finding.measurement)
    entries["Reason"] = "IfcText", finding.reason
    return entries


def _measured(of: Measurement) -> dict[str, tuple[str, Any]]:
    loa = {} if of.loa is None else {"LevelOfAccuracy": ("IfcLabel", of.loa)}
    return {
        **loa,
        "Conclusive": ("IfcBoolean", of.conclusive),
        "ShareSeen": ("IfcNormalisedRatioMeasure", of.seen),
        "Views": ("IfcInteger", of.views),
    }


def _describe(model: ifcopenshell.file, product: Entity, properties: dict[str, tuple[str, Any]]) -> None:
    """Gives a product the property set."""
    values = [
        model.create_entity("IfcPropertySingleValue", Name=name, NominalValue=model.create_entity(kind, value))
        for name, (kind, value) in properties.items()
    ]
    history = product.OwnerHistory
    described = model.create_entity(
        "IfcPropertySet", _guid(f"{product.GlobalId}/set"), history, PROPERTY_SET, None, values
    )
    model.create_entity(
        "IfcRelDefinesByProperties", _guid(f"{product.GlobalId}/rel"), history, None, None, [product], described
    )


def _guid(name: str) -> str:
    return str(ifcopenshell.guid.compress(uuid.uuid5(uuid.NAMESPACE_OID, name).hex))


def _color(model: ifcopenshell.file, product: Entity, status: str, styles: dict[str, Entity]) -> None:
    """Colours the product's body; a style that it has is replaced, one of its material is outdone."""
    body = _body(product)
    if status not in COLORS or body is None:
        return
    if status not in styles:
        styles[status] = _style(model, status)
    style = styles[status]
    for item in body.Items:
        own = list(item.StyledByItem)
        if own:
            own[0].Styles = (style,)
        else:
            model.create_entity("IfcStyledItem", item, (style,), None)


def _body(product: Entity) -> Entity | None:
    """The representation that has the product's body, in whatever context."""
    shape = product.Representation
    own = shape.Representations if shape is not None else ()
    return next((r for r in own if r.RepresentationIdentifier == "Body"), None)


def _style(model: ifcopenshell.file, status: str) -> Entity:
    """What a styled item refers to; IFC2X3 wraps it."""
    (red, green, blue), transparency = COLORS[status]
    color = model.create_entity("IfcColourRgb", None, red, green, blue)
    shading = model.create_entity(
        "IfcSurfaceStyleRendering", SurfaceColour=color, Transparency=transparency, ReflectanceMethod="FLAT"
    )
    style = model.create_entity("IfcSurfaceStyle", f"As built: {status}", "BOTH", (shading,))
    if model.schema == "IFC2X3":
        return model.create_entity("IfcPresentationStyleAssignment", (style,))
    return style


def _proxy(model: ifcopenshell.file, wall: UnplannedWall) -> Entity:
    """A slab where the side of the wall was seen."""
    history = next(iter(model.by_type("IfcOwnerHistory")), None)
    proxy = model.create_entity(
        "IfcBuildingElementProxy", _guid(f"{wall.name}/{wall.start}/{wall.end}"), history, f"Unplanned wall {wall.name}"
    )
    metre = calculate_unit_scale(model)
    length = float(np.hypot(wall.end[0] - wall.start[0], wall.end[1] - wall.start[1])) / metre
    builder, half = ShapeBuilder(model), _THICK / 2 / metre
    outline = builder.polyline([(0.0, -half), (length, -half), (length, half), (0.0, half)], closed=True)
    solid = builder.extrude(outline, magnitude=(wall.high - wall.low) / metre)
    proxy.Representation = model.create_entity(
        "IfcProductDefinitionShape", None, None, [builder.get_representation(_body_context(model), [solid])]
    )
    T = np.eye(4)
    along = np.subtract(wall.end, wall.start) / (length * metre)
    T[:2, :2] = [[along[0], -along[1]], [along[1], along[0]]]
    T[:3, 3] = *wall.start, wall.low
    ifcopenshell.api.geometry.edit_object_placement(model, product=proxy, matrix=T)
    for storey in _storeys(model, wall.storey):
        model.create_entity(
            "IfcRelContainedInSpatialStructure", _guid(f"{proxy.GlobalId}/in"), history, None, None, [proxy], storey
        )
    return proxy


def _storeys(model: ifcopenshell.file, global_id: str | None) -> Iterator[Entity]:
    """The storey of that id, else the first there is."""
    named = [s for s in model.by_type("IfcBuildingStorey") if s.GlobalId == global_id]
    yield from (named or model.by_type("IfcBuildingStorey"))[:1]


def _body_context(model: ifcopenshell.file) -> Entity:
    """The context that the walls' bodies are in."""
    for wall in model.by_type("IfcWall"):
        body = _body(wall)
        if body is not None:
            return body.ContextOfItems
    return model.by_type("IfcGeometricRepresentationContext")[0]
