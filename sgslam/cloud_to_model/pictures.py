"""The colours of distances, the histogram of the whole cloud, and a heat map of each element."""

import io
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from data.common.files import write_atomically
from sgslam.cloud_to_model.distances import CloudToModel

if TYPE_CHECKING:
    from data.plans.elements import PlannedElement  # loads ifcopenshell

Floats = NDArray[np.float64]
CELL = 0.05  # m, of a heat map
GREY = (150, 150, 150)  # what is near no planned surface
_COLOURS = "RdBu_r"  # red before the planned face, blue behind it; also distinguished by colour-blind readers
_DPI = 110


def colours(distance: Floats, limit: float) -> NDArray[np.uint8]:
    """(N, 3) RGB of distances (m), whose colours differ up to `limit`; grey for NaN."""
    from matplotlib import colormaps

    share = np.clip(np.nan_to_num(distance) / limit, -1, 1) / 2 + 0.5
    shown = np.rint(255 * colormaps[_COLOURS](share)[:, :3]).astype(np.uint8)
    return np.where(np.isnan(distance)[:, None], np.array(GREY, np.uint8), shown)


def write_histogram(found: CloudToModel, tolerance: float, path: Path) -> None:
    """How often each distance is, with the tolerance marked."""
    figure = _figure(7.0, 3.0)
    axes = figure.subplots()
    axes.hist(1000 * found.distance[found.compared], 1000 * found.edges, color="#0072b2")
    for sign in (-1, 1):
        axes.axvline(1000 * sign * tolerance, color="#d55e00", linewidth=1.0)
    axes.set(xlabel="distance from the planned face (mm), positive before it", ylabel="points")
    _save(figure, path)


def write_heat_map(found: CloudToModel, number: int, element: "PlannedElement", limit: float, path: Path) -> None:
    """The mean distance in each cell of an element's faces; walls upright, the others in plan view."""
    faces = list(_faces(found, number))
    widest = max(grid.shape[1] for _, grid in faces) * CELL
    tallest = max(grid.shape[0] for _, grid in faces) * CELL
    figure = _figure(min(max(widest, 3.0), 12.0) + 1.0, len(faces) * min(max(tallest, 1.5), 6.0) + 0.6)
    drawn: Any = None
    for axes, (label, grid) in zip(figure.subplots(len(faces), squeeze=False).flat, faces, strict=True):
        extent = (0, grid.shape[1] * CELL, 0, grid.shape[0] * CELL)
        drawn = axes.imshow(1000 * grid, _COLOURS, origin="lower", extent=extent, vmin=-1000 * limit, vmax=1000 * limit)
        axes.set(xlabel="m", ylabel="m")
        axes.set_title(label, fontsize=8)
    figure.suptitle(f"{element.name or element.ifc_class} ({element.storey})", fontsize=9)
    figure.colorbar(drawn, ax=figure.axes, label="mm, positive before the planned face", shrink=0.8)
    _save(figure, path)


def _faces(found: CloudToModel, number: int) -> Iterator[tuple[str, Floats]]:
    """Each face of an element by the axis that its normal is nearest to, and (rows, columns) its mean distances."""
    of = np.flatnonzero(found.element == number)
    for side in np.unique(found.side[of]).tolist():
        own = of[found.side[of] == side]
        axis = side % 3
        across = [0, 1] if axis == 2 else [1 - axis, 2]
        label = f"face towards {'+' if side < 3 else '-'}{'xyz'[axis]}"
        yield label, _mean_in_cells(found.points[own][:, across], found.distance[own])


def _mean_in_cells(places: Floats, values: Floats) -> Floats:
    """(rows, columns) the means in the cells of places (N, 2); NaN where there is none."""
    cells = np.floor((places - places.min(axis=0)) / CELL).astype(np.int64)
    shape = cells.max(axis=0) + 1
    flat = cells[:, 1] * shape[0] + cells[:, 0]
    counts = np.bincount(flat, minlength=shape.prod())
    sums = np.bincount(flat, values, minlength=shape.prod())
    with np.errstate(invalid="ignore"):
        return np.asarray((sums / counts).reshape(shape[1], shape[0]))


def _figure(width: float, height: float) -> Any:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def _save(figure: Any, path: Path) -> None:
    drawn = io.BytesIO()
    figure.savefig(drawn, format="png", dpi=_DPI, metadata={"Software": None})
    write_atomically(path, drawn.getvalue())
