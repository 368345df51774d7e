"""Chart of the position error over time, as inline SVG, where the ground truth is known."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.trajectory import Trajectory
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

    @property
    def rmse(self) -> float:
        """The root mean square of the errors."""
        return float(np.sqrt(np.mean(self.errors**2)))

    def summary(self) -> str:
        """Its label with RMSE and maximum."""
        return f"{self.label}: RMSE {metres(self.rmse)}, largest {metres(float(self.errors.max()))}"


def error_lines(data: ReportData) -> list[ErrorLine]:
    """Position errors of odometry and trajectory against the truth; those that can be computed.

    An anchored trajectory is compared in the BIM frame without alignment, as far as it is known; others are aligned
    first.
    """
    if data.truth is None or not len(data.trajectory_map):
        return []
    start, ours, label = int(data.trajectory_map.stamps_ns[0]), data.trajectory_map, "trajectory, aligned"
    if data.T_bim_map is not None:
        ours, label = data.known.transformed(data.T_bim_map), "trajectory in the BIM frame, not aligned"
    odometry = error_line("odometry", "odometry, aligned", data.trajectory_odometry, data.truth, start, True)
    trajectory = error_line("trajectory", label, ours, data.truth, start, data.T_bim_map is None)
    return [line for line in (odometry, trajectory) if line is not None]


def error_line(
    name: str, label: str, trajectory: Trajectory, truth: Trajectory, start_ns: int, aligned: bool
) -> ErrorLine | None:
    """The errors of a trajectory, which is `aligned` to the truth first or is in its frame; None where no stamps are
    close, or it cannot be aligned."""
    ours, true = associate(trajectory.stamps_ns, truth.stamps_ns)
    if not len(ours):
        return None
    points, targets = trajectory.positions[ours], truth.positions[true]
    if aligned:
        try:
            T = align_se3(points, targets)
        except UserError:
            return None
        points = transform_points(T, points)
    seconds = (trajectory.stamps_ns[ours] - start_ns) / 1e9
    return ErrorLine(name, label, seconds, np.linalg.norm(points - targets, axis=1))


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
