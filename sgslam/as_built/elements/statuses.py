"""The progress of each element, whether it is there, whatever the tolerance; and how much of it was seen."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from data.geometry.raycast import area_normals
from data.plans.bodies import PlannedElement
from sgslam.as_built.elements.likelihoods import Finding, Progress
from sgslam.as_built.elements.rays import CELL, NORMAL_STEPS, SeenRays, Sightings, towards
from sgslam.config.sensor import BUILDING, SENSOR

Floats = NDArray[np.float64]


def with_progress(
    elements: Sequence[PlannedElement], found: Sequence[Finding], rays: SeenRays, seen: Sightings
) -> list[Finding]:
    """The findings with progress and coverage. What was `seen` is of the solids, in their order.

    Where the judgement leaves open whether an element is there, the rays towards its planned place tell why: most end
    before it, some reach it, or there are none.
    """
    open_ = [k for k, (element, f) in enumerate(zip(elements, found, strict=True)) if _is_open(element, f)]
    counts = dict(zip(open_, towards(rays, [elements[k].triangles for k in open_]).tolist(), strict=True))
    solid = iter(range(len(elements)))
    whole = []
    for k, (element, f) in enumerate(zip(elements, found, strict=True)):
        progress: Progress = "not found" if f.verdict == "absent" else "installed"
        if k in counts:
            reaching, hidden = counts[k]
            progress = "occluded" if hidden > reaching else "not enough data" if reaching else "no data"
        coverage = _covered(element, f, seen, next(solid)) if element.kind == "solid" else f.seen
        whole.append(replace(f, progress=progress, coverage=coverage))
    return whole


def _is_open(element: PlannedElement, f: Finding) -> bool:
    """Whether an element may be there or not; that of an opening is known where its edges are in doubt."""
    is_measured = f.offset is not None and not (f.doubt and element.kind == "solid")
    return f.verdict in ("not seen", "uncertain") and not is_measured


def _covered(element: PlannedElement, f: Finding, seen: Sightings, number: int) -> float:
    """The share of an element's face at which it stands or that is seen through, of the better seen one of both sides.

    A cell counts with its whole area, also at the edge of the face.
    """
    mine = seen.element == number
    shift = np.zeros(3) if f.offset is None or f.direction is None else f.offset * np.array(f.direction)
    normal, axis = seen.normal[mine], main_axis(element.triangles)
    before, towards_sensor = seen.offset[mine] - normal @ shift, normal @ axis
    shown = (np.abs(before) < 3 * SENSOR.range_noise) | (before < -SENSOR.apart)
    area = area_normals(element.triangles)
    size = np.linalg.norm(area, axis=1)
    face = float(size[np.abs(area @ axis) > BUILDING.parallel * size].sum()) / 2  # of one side
    flat = int(np.argmax(np.abs(axis)))  # the axis along which the cells of a face lie behind each other
    cells = np.delete(seen.cell[mine], flat, axis=1)
    sides = [shown & (sign * towards_sensor > BUILDING.parallel) for sign in (-1, 1)]
    most = max(len(np.unique(cells[side], axis=0)) for side in sides)
    return min(1.0, most * CELL**2 / abs(axis[flat]) / face)


def main_axis(triangles: Floats) -> Floats:
    """(3,) the unit normal of most of a body's surface: of a wall's two sides, not of its ends and jambs."""
    normal = area_normals(triangles)
    area = np.linalg.norm(normal, axis=1)
    axis = normal[area > 0] / area[area > 0, None]
    leading = np.abs(axis[:, 0]) > 1 / NORMAL_STEPS, np.abs(axis[:, 1]) > 1 / NORMAL_STEPS
    axis *= np.sign(np.select(leading, (axis[:, 0], axis[:, 1]), axis[:, 2]))[:, None]
    _, first, group = np.unique(np.rint(NORMAL_STEPS * axis), axis=0, return_index=True, return_inverse=True)
    return np.asarray(axis[first[np.argmax(np.bincount(group.ravel(), area[area > 0]))]])
