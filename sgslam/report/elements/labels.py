"""Names of elements, their kinds and their verdicts, as readers see them."""

import re
from collections.abc import Mapping
from typing import Any

from sgslam.as_built.deviation_bands import UNPLANNED

VERDICTS = ("moved", "absent", UNPLANNED, "uncertain", "as planned", "not seen")  # what needs a look comes first
_SPREAD_OUT = ("IfcSlab", "IfcCovering")  # they lie under or over everything else in plan view


def element_name(entry: Mapping[str, Any]) -> str:
    """The element's name in the model; its kind where it has none."""
    return str(entry["name"]).strip() or f"{kind(entry['ifc_class'])} without a name"


def kind(ifc_class: str) -> str:
    """`Wall` of IfcWallStandardCase, `Curtain wall` of IfcCurtainWall."""
    words = re.findall(r"[A-Z][a-z]*", ifc_class.removeprefix("Ifc").removesuffix("StandardCase"))
    return " ".join(words).capitalize() if words else ifc_class


def is_spread_out(ifc_class: str) -> bool:
    """Whether an element covers others in plan view, as slabs do."""
    return ifc_class.startswith(_SPREAD_OUT)


def slug(verdict: str) -> str:
    """A verdict as part of a CSS class."""
    return verdict.replace(" ", "-")
