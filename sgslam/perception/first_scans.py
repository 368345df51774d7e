"""Refuses scans that are not in metres, or not in the sensor's frame: by the first few, before anything is tracked."""

from collections.abc import Iterable, Iterator
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from data import UserError
from data.scans import Scan

_FEW = 3  # scans: a single odd one proves nothing
_FARTHEST = 100.0  # m, median range indoors and out of doors; in millimetres the sensor would touch all that it sees
_OUTSIDE = 10.0  # times the extent of a scan: a sensor so far from all that it sees is not at the origin


def in_metres_and_sensor_frame(scans: Iterable[Scan]) -> Iterator[Scan]:
    """Yields the scans. Raises UserError if each of the first few is in another unit or frame."""
    rest, first, fault = iter(scans), list[Scan](), None
    for scan in islice(rest, _FEW):
        first.append(scan)
        fault = _fault(scan.points)
        if fault is None:
            break
    if fault is not None:
        raise UserError(f"{first[-1].path}: {fault}")
    yield from first
    yield from rest


def _fault(points: NDArray[np.float64]) -> str | None:
    """What is wrong with the frame or the unit of a scan (N, 3), None where nothing is."""
    middle = np.median(points, axis=0)
    distance = float(np.linalg.norm(middle))
    extent = float(np.median(np.linalg.norm(points - middle, axis=1)))
    if distance > _OUTSIDE * extent:
        return (
            f"the scan lies {distance:.0f} m from the origin and is {2 * extent:.0f} m wide: the scans seem to be in "
            "one world frame; give each in its own sensor frame"
        )
    far = float(np.median(np.linalg.norm(points, axis=1)))
    if far > _FARTHEST:
        return (
            f"the median range is {far:.0f} m: the scans are not in metres; divide millimetres by 1000, centimetres "
            "by 100"
        )
    return None
