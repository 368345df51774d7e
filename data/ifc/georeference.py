"""The georeference of an IFC model: IfcMapConversion with its IfcProjectedCRS, or the property sets of IFC2X3."""

from typing import Any

import ifcopenshell
import numpy as np
from ifcopenshell.util.geolocation import auto_xyz2enh, get_crs, get_true_north
from ifcopenshell.util.unit import calculate_unit_scale, get_unit_scale

from data.scene_graph import Georeference

_FAR = 1e6  # units of the model, at which the map conversion shows its rotation to the last digit
_SCALES = 0.95, 1.05  # of projections in use, from the building to the map


def georeference_of(model: ifcopenshell.file) -> tuple[Georeference | None, list[str]]:
    """None where the model has none, or none that holds, which a notice says."""
    try:
        crs: dict[str, Any] | None = get_crs(model)
        is_projected = crs is not None and crs.get("type", "IfcProjectedCRS") == "IfcProjectedCRS"
        if crs is None or not is_projected:
            return None, []
        origin, ahead = (np.array(auto_xyz2enh(model, x, 0.0, 0.0), dtype=float) for x in (0.0, _FAR))
        turned, project = (ahead - origin)[:2], float(calculate_unit_scale(model))
        stated = float(np.hypot(*turned)) / _FAR
        unit = _metres(crs.get("MapUnit")) or (project if _is_scale(stated) else 1.0)
        # models in millimetres may state 0.001 for maps in metres, as they should, or leave it out
        scale = stated * unit / project if _is_scale(stated * unit / project) else stated
        easting, northing, height = (origin * unit).tolist()
        rotation, true_north = float(np.arctan2(turned[1], turned[0])), float(np.radians(get_true_north(model)))
        name = str(crs.get("Name") or "unnamed")
        found = Georeference(name, easting, northing, height, rotation, round(scale, 12), true_north)
    except Exception as error:  # attributes of other types than the schema's, in property sets for instance
        return None, [f"the georeference cannot be read ({type(error).__name__}) and is left out"]
    if not _is_scale(scale) or not np.isfinite(origin).all():
        return None, [f"the georeference has a scale of {stated:g} for these units and is left out; give 1, or 0.001"]
    return found, []


def _is_scale(value: float) -> bool:
    return _SCALES[0] < value < _SCALES[1]


def _metres(unit: Any) -> float | None:
    """The length of a map's unit; None where it is not stated."""
    if unit is None or isinstance(unit, str):  # of IFC2X3
        return 1.0 if str(unit).upper() in ("METRE", "METER", "M") else None
    return float(get_unit_scale(unit))
