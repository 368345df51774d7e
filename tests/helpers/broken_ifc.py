"""IFC models that lack something or are broken, made of any sound one."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import ifcopenshell
import ifcopenshell.api.root

Model = Any  # ifcopenshell.file


def _without(ifc_class: str) -> Callable[[Model], None]:
    def edit(model: Model) -> None:
        for entity in model.by_type(ifc_class):
            model.remove(entity)

    return edit


def _moved(ifc_class: str, x: float) -> Callable[[Model], None]:
    def edit(model: Model) -> None:
        for product in model.by_type(ifc_class):
            placement = product.ObjectPlacement and product.ObjectPlacement.RelativePlacement
            if placement:
                own_x, *others = placement.Location.Coordinates
                placement.Location = model.createIfcCartesianPoint((own_x + x, *others))

    return edit


def _set(ifc_class: str, name: str, value: object) -> Callable[[Model], None]:
    def edit(model: Model) -> None:
        for entity in model.by_type(ifc_class):
            setattr(entity, name, value)

    return edit


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
    "no walls": _without("IfcWall"),
    "no storeys": _without("IfcBuildingStorey"),
    "nothing is contained": _without("IfcRelContainedInSpatialStructure"),
    "no openings": _without("IfcRelVoidsElement"),
    "doors to nowhere": _moved("IfcDoor", 500.0),
    "doors without a body": _set("IfcDoor", "Representation", None),
    "beyond the earth": _moved("IfcSite", 1e30),
    "no units": _without("IfcUnitAssignment"),
    "one id for all": _set("IfcElement", "GlobalId", "0000000000000000000000"),
}
TEXTS: dict[str, Callable[[str], str]] = {
    "placements are missing": _lines_without("IFCLOCALPLACEMENT", 2),
    "walls are missing, their openings stay": _lines_without("IFCWALL(STANDARDCASE)?", 2),
    "fillings of nothing": _argument("IFCRELFILLSELEMENT", 4, "$"),
    "infinite elevations": _argument("IFCBUILDINGSTOREY", 9, "1.E999"),
    "directions of no length": lambda text: re.sub(r"(IFCDIRECTION) *\(\(.*\)\)", r"\1((0.,0.,0.))", text),
    "a schema of the future": lambda text: re.sub(r"FILE_SCHEMA *\(\('.*?'\)\)", "FILE_SCHEMA(('IFC9'))", text),
    "cut off, with an end": lambda text: text[: len(text) // 2] + ";\nENDSEC;\nEND-ISO-10303-21;\n",
    "empty": lambda text: "",
}
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
