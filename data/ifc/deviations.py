"""Writes a copy of an IFC model whose elements show how they were built: by a property set and a colour."""

import uuid
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import ifcopenshell
import ifcopenshell.api.geometry
import ifcopenshell.guid
import numpy as np
from ifcopenshell.util.shape_builder import ShapeBuilder
from ifcopenshell.util.unit import calculate_unit_scale

from data.common.files import write_atomically
from data.ifc.products import open_ifc

Entity: TypeAlias = ifcopenshell.entity_instance
Entry = Mapping[str, Any]  # of `elements` and of `unplanned` in elements.json
Rgb = tuple[float, float, float]
PROPERTY_SET = "AsBuilt"
LABELS = {"Status": "verdict", "Progress": "progress", "Tolerance": "tolerance", "LevelOfAccuracy": "loa"}
COLORS: dict[str, tuple[Rgb, float]] = {  # and transparency; distinct to colour-blind eyes too
    "as planned": ((0.75, 0.82, 0.75), 0.0),
    "moved": ((0.84, 0.37, 0.0), 0.0),
    "absent": ((0.34, 0.71, 0.91), 0.6),
    "unplanned": ((0.8, 0.47, 0.65), 0.0),
}
_THICK = 0.02  # m, of the slab that shows the side of an unplanned wall


def write_as_built(ifc: Path | str, elements: Sequence[Entry], unplanned: Sequence[Entry], path: Path | str) -> int:
    """Writes the copy atomically, with the unplanned walls, and returns how many of the elements are in the model.

    Lengths and angles are in the model's own units. Raises UserError for a file that cannot be read as IFC.
    """
    model = open_ifc(ifc)
    styles: dict[str, Entity] = {}
    marked = 0
    for entry in elements:
        try:
            element = model.by_guid(entry["global_id"])
        except RuntimeError:
            continue
        marked += 1
        _describe(model, element, _properties(model, entry))
        _color(model, element, entry["verdict"], styles)
    for wall in unplanned:
        proxy = _proxy(model, wall)
        _describe(model, proxy, {"Status": ("IfcLabel", "unplanned"), "Reason": ("IfcText", wall["reason"])})
        _color(model, proxy, "unplanned", styles)
    write_atomically(path, model.to_string())
    return marked


def project_of(ifc: Path | str) -> str:
    """The GlobalId of a model's IfcProject, empty where it has none. Raises as `open_ifc` does."""
    return next((str(p.GlobalId) for p in open_ifc(ifc).by_type("IfcProject")), "")


def _properties(model: ifcopenshell.file, of: Entry) -> dict[str, tuple[str, Any]]:
    """Names to IFC types and values."""
    metre, radian = calculate_unit_scale(model), calculate_unit_scale(model, "PLANEANGLEUNIT")
    entries: dict[str, tuple[str, Any]] = {name: ("IfcLabel", of[key]) for name, key in LABELS.items() if of[key]}
    if of["offset_m"] is not None:
        entries["Offset"] = "IfcLengthMeasure", abs(of["offset_m"]) / metre
        for axis, share in zip("XYZ", of["direction"], strict=True):
            entries[f"Offset{axis}"] = "IfcLengthMeasure", of["offset_m"] * share / metre
    if of["sigma_m"] is not None:
        entries["OffsetSigma"] = "IfcLengthMeasure", of["sigma_m"] / metre
    if of["turn_rad"] is not None:
        entries["Turn"] = "IfcPlaneAngleMeasure", of["turn_rad"] / radian
    return entries | {
        "Conclusive": ("IfcBoolean", of["conclusive"]),
        "Coverage": ("IfcNormalisedRatioMeasure", of["coverage"]),
        "ShareSeen": ("IfcNormalisedRatioMeasure", of["seen"]),
        "Views": ("IfcInteger", of["views"]),
        "Reason": ("IfcText", of["reason"]),
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


def _proxy(model: ifcopenshell.file, wall: Entry) -> Entity:
    """A slab where the side of the wall was seen."""
    history = next(iter(model.by_type("IfcOwnerHistory")), None)
    (start, end), (low, high), name = map(tuple, wall["trace"]), wall["height_m"], wall["id"]
    proxy = model.create_entity(
        "IfcBuildingElementProxy", _guid(f"{name}/{start}/{end}"), history, f"Unplanned wall {name}"
    )
    metre = calculate_unit_scale(model)
    length = float(np.hypot(end[0] - start[0], end[1] - start[1])) / metre
    builder, half = ShapeBuilder(model), _THICK / 2 / metre
    outline = builder.polyline([(0.0, -half), (length, -half), (length, half), (0.0, half)], closed=True)
    solid = builder.extrude(outline, magnitude=(high - low) / metre)
    proxy.Representation = model.create_entity(
        "IfcProductDefinitionShape", None, None, [builder.get_representation(_body_context(model), [solid])]
    )
    T = np.eye(4)
    along = np.subtract(end, start) / (length * metre)
    T[:2, :2] = [[along[0], -along[1]], [along[1], along[0]]]
    T[:3, 3] = *start, low
    ifcopenshell.api.geometry.edit_object_placement(model, product=proxy, matrix=T)
    storeys = model.by_type("IfcBuildingStorey")
    named = [s for s in storeys if wall["storey"] in (s.Name, s.LongName, s.GlobalId)]
    for storey in (named or storeys)[:1]:
        model.create_entity(
            "IfcRelContainedInSpatialStructure", _guid(f"{proxy.GlobalId}/in"), history, None, None, [proxy], storey
        )
    return proxy


def _body_context(model: ifcopenshell.file) -> Entity:
    """The context that the walls' bodies are in."""
    for wall in model.by_type("IfcWall"):
        body = _body(wall)
        if body is not None:
            return body.ContextOfItems
    return model.by_type("IfcGeometricRepresentationContext")[0]
