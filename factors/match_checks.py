"""What can be wrong with a match, a plan and the keys of an own graph, each reported in one line."""

import gtsam
import numpy as np
from numpy.typing import NDArray

from factors.protocols import Match, Plan

Floats = NDArray[np.float64]
_FARTHEST = 300.0  # m: with longer levers from the BIM frame to a wall the optimisation is poorly conditioned
_GATE = 0.5  # cosine of 60 degrees: beyond it the residual of a plane leads to the wrong side
_ACROSS = np.sin(np.radians(10))  # walls at a smaller angle let the BIM frame slide along them


def unique_place(match: Match) -> tuple[float, float, float]:
    """(yaw, x, y) of a unique match. Raises ValueError for others, and if it pairs no wall surface."""
    if match.status != "unique" or match.T_a_s is None:
        raise ValueError(f"the match is not unique but '{match.status}' ({match.reason}); anchor nothing to it")
    if not match.wall_surfaces:
        raise ValueError("the match pairs no wall surface; rooms alone anchor no plane")
    return match.T_a_s


def planned_wall(a_id: str, plan: Plan) -> tuple[Floats, Floats]:
    """(2,) centroid and (2,) unit normal of a planned wall surface. Raises ValueError if it has none."""
    surface = plan.surface_by_id.get(a_id)
    if surface is None:
        raise ValueError(f"the plan has no wall surface '{a_id}'; it is not the plan that was matched")
    found = []
    for what, value in (("centroid", surface.centroid), ("normal", surface.normal)):
        point = np.asarray(value, dtype=float)
        if point.shape != (2,) or not np.all(np.isfinite(point)):
            raise ValueError(f"the {what} of the planned wall surface '{a_id}' is {point}; (x, y) is expected")
        found.append(point)
    return found[0], found[1] / np.linalg.norm(found[1])


def check_sides(s_id: str, a_id: str, seen: Floats, planned: Floats) -> None:
    """Raises ValueError unless the normal (3,) as seen, in the BIM frame, and the planned one (2,) are alike."""
    cosine = float(seen[:2] @ planned)
    if cosine < -_GATE:
        raise ValueError(f"'{s_id}' faces away from the planned '{a_id}'; a normal points to the side that was seen")
    if cosine < _GATE:
        angle = np.degrees(np.arccos(cosine))
        raise ValueError(f"'{s_id}' is turned {angle:.0f} degrees from the planned '{a_id}'; are the keys its own?")


def check_near(a_id: str, place: Floats, place_in_bim: Floats) -> None:
    """Raises ValueError if a wall's place (3,), from the BIM frame's origin, is too far."""
    if (away := float(np.linalg.norm(place))) > _FARTHEST:
        near = tuple(place_in_bim.round().tolist())
        raise ValueError(f"the planned '{a_id}' is {away:.0f} m from the origin; give one near it, origin={near}")


def check_directions(normals: list[Floats]) -> None:
    """Raises ValueError if all normals (2,) are parallel."""
    (x, y), all_normals = normals[0], np.array(normals)
    if np.abs(x * all_normals[:, 1] - y * all_normals[:, 0]).max() < _ACROSS:
        raise ValueError("all matched walls are parallel; the BIM frame could slide along them; match one across them")


def name_of(key: int) -> str:
    """A GTSAM key as words say it, for example x0."""
    return str(gtsam.DefaultKeyFormatter(key))
