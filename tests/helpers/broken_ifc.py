"""IFC models that lack something or are broken, made of any sound one."""

import re
from collections.abc import Callable
from pathlib import Path

import ifcopenshell

WITHOUT = (
    "IfcSpace",
    "IfcWall",
    "IfcBuildingStorey",
    "IfcProject",
    "IfcRelContainedInSpatialStructure",
    "IfcRelAggregates",
    "IfcRelVoidsElement",
    "IfcUnitAssignment",
)
SET = {
    "nothing has a body": ("IfcProduct", "Representation", None),
    "walls of no height": ("IfcExtrudedAreaSolid", "Depth", 1e-9),
    "no names": ("IfcRoot", "Name", None),
    "storeys without elevation": ("IfcBuildingStorey", "Elevation", None),
    "one id for all": ("IfcElement", "GlobalId", "0000000000000000000000"),
}


def _lines_without(ifc_class: str, every: int = 1) -> Callable[[str], str]:
    """The file without every n-th line of a class, to which other lines still refer."""

    def edit(text: str) -> str:
        lines = text.splitlines(True)
        found = [k for k, line in enumerate(lines) if re.match(rf"#\d+ *= *{ifc_class}\b", line, re.IGNORECASE)]
        gone = set(found[every - 1 :: every])
        return "".join(line for k, line in enumerate(lines) if k not in gone)

    return edit


TEXTS: dict[str, Callable[[str], str]] = {
    "placements are missing": _lines_without("IFCLOCALPLACEMENT", 2),
    "bodies are missing": _lines_without("IFCSHAPEREPRESENTATION", 3),
    "walls are missing, their openings stay": _lines_without("IFCWALL(STANDARDCASE)?", 2),
    "openings are missing, their fillings stay": _lines_without("IFCOPENINGELEMENT"),
    "storeys are missing, their content stays": _lines_without("IFCBUILDINGSTOREY", 2),
    "infinite places": lambda text: re.sub(r"(IFCCARTESIANPOINT) *\(\([^,]*,", r"\1((1.E999,", text, count=40),
    "directions of no length": lambda text: re.sub(r"(IFCDIRECTION) *\(\(.*\)\)", r"\1((0.,0.,0.))", text),
    "a schema of the future": lambda text: re.sub(r"FILE_SCHEMA *\(\('.*?'\)\)", "FILE_SCHEMA(('IFC9'))", text),
    "cut off, with an end": lambda text: text[: len(text) // 2] + ";\nENDSEC;\nEND-ISO-10303-21;\n",
}
BROKEN = [*WITHOUT, *SET, *TEXTS]


def write_broken(sound: Path, kind: str, path: Path) -> Path:
    """Writes the model `sound` with that fault."""
    if kind in TEXTS:
        path.write_text(TEXTS[kind](sound.read_text(errors="replace")))
        return path
    model = ifcopenshell.open(str(sound))
    if kind in SET:
        ifc_class, name, value = SET[kind]
        for entity in model.by_type(ifc_class):
            setattr(entity, name, value)
    else:
        for entity in model.by_type(kind):
            model.remove(entity)
    model.write(str(path))
    return path
