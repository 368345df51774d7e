"""Chart of the position error over time, as inline SVG, where the ground truth is known."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from sgslam.geometry.frames import transform_points
from sgslam.geometry.trajectory_errors import align_se3, associate
from sgslam.report.contents import ReportData
from sgslam.report.drawn_paths import subsample
from sgslam.report.number_formats import metres

Array = NDArray[np.float64]
WIDTH, HEIGHT, MARGIN = 1080, 300, 60  # of the drawing; right of its left and above its lower margin are the axes
SAMPLES = 600  # drawn of each line, each the largest error up to the next, so that no peak is lost


@dataclass(frozen=True)
class ErrorLine:
    """`seconds` (N,) since the first scan, increasing; `errors` (N,) metres."""

    name: str
    label: str
    seconds: Array
    errors: Array

    def summary(self) -> str:
        """Its label with RMSE and maximum."""
        rmse = float(np.sqrt(np.mean(self.errors**2)))
        return f"{self.label}: RMSE {metres(rmse)}, largest {metres(float(self.errors.max()))}"


def error_lines(data: ReportData) -> list[ErrorLine]:
    """Position errors of odometry and trajectory against the truth; those that can be computed.

    An anchored trajectory is compared in the BIM frame without alignment, as far as it is known; others are aligned
    first.
    """
    if data.truth is None or not len(data.trajectory_map):
        return []
    ours = "trajectory", "trajectory, aligned", data.trajectory_map, True
    if data.T_bim_map is not None:
        in_bim = data.known.transformed(data.T_bim_map)
        ours = "trajectory", "trajectory in the BIM frame, not aligned", in_bim, False
    lines = []
    for name, label, trajectory, aligned in (("odometry", "odometry, aligned", data.trajectory_odometry, True), ours):
        own, true = associate(trajectory.stamps_ns, data.truth.stamps_ns)
        if not len(own):
            continue
        points, targets = trajectory.positions[own], data.truth.positions[true]
        try:
            points = transform_points(align_se3(points, targets), points) if aligned else points
        except UserError:
            continue
        seconds = (trajectory.stamps_ns[own] - data.trajectory_map.stamps_ns[0]) / 1e9
        lines.append(ErrorLine(name, label, seconds, np.linalg.norm(points - targets, axis=1)))
    return lines


def error_chart(data: ReportData, lines: Sequence[ErrorLine]) -> str:
    """The SVG element `#errors`: seconds on x; on y metres, logarithmic, as errors before and after anchoring differ by
    orders of magnitude. Its template adds the legend."""
    from matplotlib.ticker import MaxNLocator

    start, end = min(0.0, *(line.seconds[0] for line in lines)), max(line.seconds[-1] for line in lines)
    top = max(math.ceil(math.log10(max(line.errors.max() for line in lines) + 1e-9)), -2)  # power of ten
    parts, below = [], HEIGHT - MARGIN

    def at(seconds: Any) -> Any:
        return MARGIN + (seconds - start) / max(end - start, 1e-9) * (WIDTH - 1.2 * MARGIN)

    def height(errors: Any) -> Any:  # those below a millimetre are drawn as one
        return below - (np.log10(np.maximum(errors, 1e-3)) + 3) / (top + 3) * (HEIGHT - 1.5 * MARGIN)

    for decade in range(-3, top + 1):
        y = float(height(10.0**decade))
        parts.append(f'<line class="rule" x1="{MARGIN}" x2="{WIDTH}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(f'<text class="end" x="{MARGIN - 8}" y="{y:.1f}" dy="0.35em">{10.0**decade:g} m</text>')
    for tick in MaxNLocator(8).tick_values(start, end):
        if start <= tick <= end:
            parts.append(f'<text x="{at(tick):.1f}" y="{below + 18}">{tick:g}</text>')
    parts.append(f'<text x="{WIDTH / 2}" y="{below + 40}">seconds since the first scan</text>')
    first = data.metrics.get("first_anchor_s")
    if first is not None and data.T_bim_map is not None:
        x = float(at(float(first)))
        parts.append(f'<g class="moment"><line x1="{x:.1f}" x2="{x:.1f}" y1="20" y2="{below}"/>')
        parts.append(f'<text x="{x:.1f}" y="14">first anchor, {first:.1f} s</text></g>')
    for line in lines:
        starts = np.unique(subsample(len(line.seconds), SAMPLES))
        points = zip(at(line.seconds[starts]), height(np.maximum.reduceat(line.errors, starts)), strict=True)
        drawn = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        parts.append(f'<g class="layer-{line.name}"><polyline points="{drawn}"/></g>')
    return (
        f'<svg id="errors" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="position error against time">'
        f"{''.join(parts)}</svg>"
    )
