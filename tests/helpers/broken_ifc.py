"""IFC models that lack something or are broken, made of any sound one."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import ifcopenshell
import ifcopenshell.api.root

Model = Any  # ifcopenshell.file


def _most_walls(model: Model) -> Any:
    """The storey with the most walls."""
    return max(model.by_type("IfcBuildingStorey"), key=lambda s: sum(e.is_a("IfcWall") for e in _within(s)))


def _within(storey: Any) -> list[Any]:
    held = [e for relation in storey.ContainsElements for e in relation.RelatedElements]
    return held + [e for relation in storey.IsDecomposedBy for e in relation.RelatedObjects]


def _remove(model: Model, entities: list[Any]) -> None:
    for entity in entities:
        model.remove(entity)


def _without(ifc_class: str, keep: int = 0) -> Callable[[Model], None]:
    return lambda model: _remove(model, model.by_type(ifc_class)[keep:])


def _storey_without(ifc_class: str) -> Callable[[Model], None]:
    return lambda model: _remove(model, [e for e in _within(_most_walls(model)) if e.is_a(ifc_class)])


def _moved(ifc_class: str, x: float, y: float = 0.0, z: float = 0.0) -> Callable[[Model], None]:
    def edit(model: Model) -> None:
        for product in model.by_type(ifc_class):
            placement = product.ObjectPlacement and product.ObjectPlacement.RelativePlacement
            if placement:
                own = (*placement.Location.Coordinates, 0.0)[:3]
                moved = [a + b for a, b in zip(own, (x, y, z), strict=True)]
                placement.Location = model.createIfcCartesianPoint(moved)

    return edit


def _set(ifc_class: str, name: str, value: object) -> Callable[[Model], None]:
    def edit(model: Model) -> None:
        for entity in model.by_type(ifc_class):
            setattr(entity, name, value)

    return edit


def _empty_storeys(model: Model) -> None:
    building = model.by_type("IfcBuilding")[0]
    new = [ifcopenshell.api.root.create_entity(model, "IfcBuildingStorey", name=name) for name in ("", "Roof")]
    relation = building.IsDecomposedBy[0]
    relation.RelatedObjects = (*relation.RelatedObjects, *new)


def _flat_walls(model: Model) -> None:
    for point in model.by_type("IfcCartesianPoint"):
        if len(point.Coordinates) == 2:
            point.Coordinates = (0.0, point.Coordinates[1])


def _lines_without(ifc_class: str, every: int = 1) -> Callable[[str], str]:
    """The file without every n-th line of a class, to which other lines still refer."""

    def edit(text: str) -> str:
        count, kept = 0, []
        for line in text.splitlines():
            if re.match(rf"#\d+ *= *{ifc_class}\b", line, re.IGNORECASE):
                count += 1
                if count % every == 0:
                    continue
            kept.append(line)
        return "\n".join(kept) + "\n"

    return edit


def _argument(ifc_class: str, index: int, value: str) -> Callable[[str], str]:
    """The file with another argument, of those that are no lists, in the lines of a class."""

    def edit(text: str) -> str:
        def changed(match: re.Match[str]) -> str:
            parts = re.split(r",(?![^(]*\))", match[2])
            parts[index] = value
            return f"{match[1]}({','.join(parts)});"

        return re.sub(rf"(#\d+ *= *{ifc_class}) *\((.*)\);", changed, text, flags=re.IGNORECASE)

    return edit


EDITS: dict[str, Callable[[Model], None]] = {
    "no spaces": _without("IfcSpace"),
    "one space": _without("IfcSpace", keep=1),
    "a storey without spaces": _storey_without("IfcSpace"),
    "a storey without walls": _storey_without("IfcWall"),
    "no walls": _without("IfcWall"),
    "no storeys": _without("IfcBuildingStorey"),
    "no project": _without("IfcProject"),
    "empty storeys": _empty_storeys,
    "nothing is contained": _without("IfcRelContainedInSpatialStructure"),
    "nothing is part of anything": _without("IfcRelAggregates"),
    "no fillings": _without("IfcRelFillsElement"),
    "no openings": _without("IfcRelVoidsElement"),
    "doors to nowhere": _moved("IfcDoor", 500.0),
    "doors below the floor": _moved("IfcDoor", 0.0, 0.0, -50.0),
    "doors without a body": _set("IfcDoor", "Representation", None),
    "nothing has a body": _set("IfcProduct", "Representation", None),
    "walls without thickness": _flat_walls,
    "walls of no height": _set("IfcExtrudedAreaSolid", "Depth", 1e-9),
    "far from zero": _moved("IfcSite", 4e6, 5e6, 100.0),
    "beyond the earth": _moved("IfcSite", 1e30),
    "no units": _without("IfcUnitAssignment"),
    "no names": _set("IfcRoot", "Name", None),
    "storeys without elevation": _set("IfcBuildingStorey", "Elevation", None),
    "one elevation for all": _set("IfcBuildingStorey", "Elevation", 0.0),
    "one id for all": _set("IfcElement", "GlobalId", "0000000000000000000000"),
}  # fmt: skip
TEXTS: dict[str, Callable[[str], str]] = {
    "placements are missing": _lines_without("IFCLOCALPLACEMENT", 2),
    "bodies are missing": _lines_without("IFCSHAPEREPRESENTATION", 3),
    "points are missing": _lines_without("IFCCARTESIANPOINT", 5),
    "walls are missing, their openings stay": _lines_without("IFCWALL(STANDARDCASE)?", 2),
    "openings are missing, their fillings stay": _lines_without("IFCOPENINGELEMENT"),
    "spaces are missing, their relations stay": _lines_without("IFCSPACE"),
    "storeys are missing, their content stays": _lines_without("IFCBUILDINGSTOREY", 2),
    "fillings of nothing": _argument("IFCRELFILLSELEMENT", 4, "$"),
    "openings in nothing": _argument("IFCRELVOIDSELEMENT", 4, "$"),
    "elevations that are no numbers": _argument("IFCBUILDINGSTOREY", 9, "NAN"),
    "infinite elevations": _argument("IFCBUILDINGSTOREY", 9, "1.E999"),
    "directions of no length": lambda text: re.sub(r"(IFCDIRECTION) *\(\(.*\)\)", r"\1((0.,0.,0.))", text),
    "infinite places": lambda text: re.sub(r"(IFCCARTESIANPOINT) *\(\([^,]*,", r"\1((1.E999,", text, count=40),
    "places that are no numbers": lambda text: re.sub(r"(IFCCARTESIANPOINT) *\(\([^,]*,", r"\1((NAN,", text, count=40),
    "a schema of the future": lambda text: re.sub(r"FILE_SCHEMA *\(\('.*?'\)\)", "FILE_SCHEMA(('IFC9'))", text),
    "cut off": lambda text: text[: len(text) // 2],
    "cut off, with an end": lambda text: text[: len(text) // 2] + ";\nENDSEC;\nEND-ISO-10303-21;\n",
    "no data": lambda text: text[: text.index("DATA;")] + "DATA;\nENDSEC;\nEND-ISO-10303-21;\n",
    "empty": lambda text: "",
}  # fmt: skip
BROKEN = [*EDITS, *TEXTS]


def write_broken(sound: Path, kind: str, path: Path) -> Path:
    """Writes the model `sound` with that fault."""
    if kind in TEXTS:
        path.write_text(TEXTS[kind](sound.read_text(errors="replace")))
        return path
    model = ifcopenshell.open(str(sound))
    EDITS[kind](model)
    model.write(str(path))
    return path
