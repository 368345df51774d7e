"""Chart of the position error over time, as inline SVG, where the ground truth is known."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
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
from sgslam.report.plan_drawing import PlanDrawing
from sgslam.report.plan_svg import Pen

Array = NDArray[np.float64]
WIDTH, HEIGHT = 1080, 300
LEFT, RIGHT, TOP, BOTTOM = 62, 14, 36, 40  # margins
BINS = 220  # of time; RMS and maximum of each are drawn, so that no peak is lost
SAMPLES = 600  # shown when pointed at
GAP_S = 2.0  # longest time without errors over which a line is drawn
SMALLEST_M = 1e-3  # lower end of the axis
_DIGITS = {"m": 0, "cm": 2, "mm": 3}


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
    start, ours, label = int(data.trajectory_map.stamps_ns[0]), data.trajectory_map, "trajectory, aligned"
    if data.T_bim_map is not None:
        ours, label = data.known.transformed(data.T_bim_map), "trajectory in the BIM frame, not aligned"
    odometry = _line("odometry", "odometry, aligned", data.trajectory_odometry, data.truth, start, True)
    trajectory = _line("trajectory", label, ours, data.truth, start, data.T_bim_map is None)
    return [line for line in (odometry, trajectory) if line is not None]


def _line(
    name: str, label: str, trajectory: Trajectory, truth: Trajectory, start_ns: int, aligned: bool
) -> ErrorLine | None:
    ours, true = associate(trajectory.stamps_ns, truth.stamps_ns)
    if not len(ours):
        return None
    points, targets = trajectory.positions[ours], truth.positions[true]
    if aligned:
        try:
            T = align_se3(points, targets)
        except UserError:
            return None
        points = points @ T[:3, :3].T + T[:3, 3]
    seconds = (trajectory.stamps_ns[ours] - start_ns) / 1e9
    return ErrorLine(name, label, seconds, np.linalg.norm(points - targets, axis=1))


def error_chart(data: ReportData, lines: Sequence[ErrorLine]) -> str:
    """The SVG element `#errors`; its template adds the legend."""
    axes = _Axes(lines)
    drawn = "".join(f'<g class="layer-{line.name}">{axes.path(line)}</g>' for line in lines)
    first = data.metrics.get("first_anchor_s")
    mark = "" if first is None or data.T_bim_map is None else axes.mark(float(first), f"first anchor, {first:.1f} s")
    return (
        f'<svg id="errors" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="position error against time">'
        f'{axes.grid()}{mark}{drawn}<line id="cursor" y1="{TOP}" y2="{HEIGHT - BOTTOM}"/></svg>'
    )


def chart_data(data: ReportData, lines: Sequence[ErrorLine], drawing: PlanDrawing) -> dict[str, Any]:
    """JSON for pointing at the chart: samples of `seconds`, `errors` by line (m), and `place` in `#plan`."""
    shown = next((line for line in lines if line.name == "trajectory"), lines[0])
    axes, seconds = _Axes(lines), shown.seconds[subsample(len(shown.seconds), SAMPLES)]
    stamps, way = data.trajectory_map.stamps_ns, transform_points(drawing.T_plan_map, data.trajectory_map.positions)
    at = (stamps - stamps[0]) / 1e9
    place = Pen(drawing.centre()).local(np.column_stack([np.interp(seconds, at, way[:, k]) for k in (0, 1)]))
    return {
        "seconds": seconds.round(2).tolist(),
        "x": axes.x(seconds).round(1).tolist(),
        "place": place.round(3).tolist(),
        "errors": {line.label: np.interp(seconds, line.seconds, line.errors).round(4).tolist() for line in lines},
    }


class _Axes:
    """Seconds on x; on y metres, logarithmic: errors before and after anchoring differ by orders of magnitude."""

    def __init__(self, lines: Sequence[ErrorLine]) -> None:
        self.start = min(0.0, *(float(line.seconds[0]) for line in lines))
        self.end = max(float(line.seconds[-1]) for line in lines)
        smallest = max(min(float(np.percentile(line.errors, 2)) for line in lines), SMALLEST_M)
        largest = max(*(float(line.errors.max()) for line in lines), 10 * smallest)
        self.decades = math.floor(math.log10(smallest)), math.ceil(math.log10(largest))

    def x(self, seconds: Any) -> Any:
        return LEFT + (seconds - self.start) / max(self.end - self.start, 1e-9) * (WIDTH - LEFT - RIGHT)

    def y(self, errors: Any) -> Any:
        low, high = self.decades
        share = (np.log10(np.clip(errors, 10.0**low, 10.0**high)) - low) / (high - low)
        return HEIGHT - BOTTOM - share * (HEIGHT - BOTTOM - TOP)

    def path(self, line: ErrorLine) -> str:
        """The RMS of each bin of time as a line, with a band up to the largest error; interrupted at gaps."""
        binned = _binned(line, self.start, self.end)
        x, rms, high = self.x(binned[:, 0]), self.y(binned[:, 1]), self.y(binned[:, 2])
        cuts = np.flatnonzero(np.diff(binned[:, 0]) > GAP_S + 2 * (self.end - self.start) / BINS) + 1
        drawn = []
        for i in np.split(np.arange(len(x)), cuts):
            band = np.concatenate([np.column_stack([x[i], high[i]]), np.column_stack([x[i], rms[i]])[::-1]])
            drawn.append(f'<polygon points="{_points(band)}"/>')
            drawn.append(f'<polyline points="{_points(np.column_stack([x[i], rms[i]]))}"/>')
        return "".join(drawn)

    def grid(self) -> str:
        """Lines and labels of both axes."""
        from matplotlib.ticker import MaxNLocator

        parts = []
        for decade in range(self.decades[0], self.decades[1] + 1):
            y, unit = float(self.y(10.0**decade)), "m" if decade >= 0 else "cm" if decade >= -2 else "mm"
            parts.append(f'<line class="rule" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y:.1f}" y2="{y:.1f}"/>')
            text = f"{10.0 ** (decade + _DIGITS[unit]):g} {unit}"
            parts.append(f'<text class="end" x="{LEFT - 8}" y="{y:.1f}" dy="0.35em">{text}</text>')
        for tick in MaxNLocator(8).tick_values(self.start, self.end):
            if self.start <= tick <= self.end:
                parts.append(f'<text x="{self.x(tick):.1f}" y="{HEIGHT - BOTTOM + 18}">{tick:g}</text>')
        middle = (LEFT + WIDTH - RIGHT) / 2
        parts.append(f'<text x="{middle:.1f}" y="{HEIGHT - 4}">seconds since the first scan</text>')
        return "".join(parts) + f'<text class="begin" x="{LEFT}" y="12">position error, logarithmic</text>'

    def mark(self, seconds: float, text: str) -> str:
        """A moment in time."""
        x = float(self.x(seconds))
        side, dx = ("end", -6) if x > 0.8 * WIDTH else ("begin", 6)
        return (
            f'<g class="moment"><line x1="{x:.1f}" x2="{x:.1f}" y1="{TOP - 14}" y2="{HEIGHT - BOTTOM}"/>'
            f'<text class="{side}" x="{x + dx:.1f}" y="{TOP - 5}">{escape(text)}</text></g>'
        )


def _binned(line: ErrorLine, start: float, end: float) -> Array:
    """(M, 3) for each bin of time: mean seconds, RMS, largest error; the samples themselves if there are few."""
    if len(line.errors) <= BINS:
        return np.column_stack([line.seconds, line.errors, line.errors])
    edges = np.linspace(start, end, BINS + 1)[1:-1]
    pieces = np.split(np.column_stack([line.seconds, line.errors]), np.searchsorted(line.seconds, edges))
    rows = [
        (t.mean(), np.sqrt(np.mean(e**2)), e.max()) for t, e in (piece.T for piece in pieces if len(piece))
    ]  # fmt: skip
    return np.array(rows)


def _points(xy: Array) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in xy)
