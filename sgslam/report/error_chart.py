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
from sgslam.report.accuracy import align_se3, associate
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
LOG_FROM = 5.0  # ratio of the lines' errors from which the axis is logarithmic
SMALLEST_M = 1e-3  # lower end of a logarithmic axis


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
    """The SVG element `#errors` with its legend."""
    axes = _Axes(lines)
    drawn = "".join(f'<g class="layer-{line.name}">{axes.path(line)}</g>' for line in lines)
    first = data.metrics.get("first_anchor_s")
    mark = "" if first is None or data.T_bim_map is None else axes.mark(float(first), f"first anchor, {first:.1f} s")
    keys = "".join(
        f'<span><svg class="key" viewBox="0 0 24 10"><g class="layer-{line.name}"><polyline points="2,5 22,5"/></g>'
        f"</svg>{escape(line.summary())}</span>"
        for line in lines
    )
    return (
        f'<div class="scroll"><svg id="errors" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" '
        f'aria-label="position error against time">{axes.grid()}{mark}{drawn}'
        f'<line id="cursor" y1="{TOP}" y2="{HEIGHT - BOTTOM}"/></svg></div>'
        f'<div class="legend plain">{keys}</div>'
        '<p class="muted" id="readout">Lines: RMS over short intervals; bands: up to the largest error. '
        "Point at the chart to see in the plan where the sensor was at that time.</p>"
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
    """Seconds on x; metres on y: linear, or logarithmic where one line is far below the other."""

    def __init__(self, lines: Sequence[ErrorLine]) -> None:
        self.start = min(0.0, *(float(line.seconds[0]) for line in lines))
        self.end = max(float(line.seconds[-1]) for line in lines)
        tops = [max(float(np.percentile(line.errors, 95)), 1e-9) for line in lines]
        self.log = max(tops) > LOG_FROM * min(tops)
        largest = max(float(line.errors.max()) for line in lines)
        if self.log:
            smallest = max(min(float(np.percentile(line.errors, 2)) for line in lines), SMALLEST_M)
            low, high = math.floor(math.log10(smallest)), math.ceil(math.log10(max(largest, 10 * smallest)))
            self.ticks = [10.0**k for k in range(low, high + 1)]
        else:
            self.ticks = _round_ticks(0.0, max(largest, SMALLEST_M), 5)

    def x(self, seconds: Any) -> Any:
        return LEFT + (seconds - self.start) / max(self.end - self.start, 1e-9) * (WIDTH - LEFT - RIGHT)

    def y(self, errors: Any) -> Any:
        low, high = self.ticks[0], self.ticks[-1]
        share = np.clip(errors, low, high)
        share = np.log(share / low) / np.log(high / low) if self.log else share / high
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
        parts = []
        for tick in self.ticks:
            y = float(self.y(tick))
            parts.append(f'<line class="rule" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y:.1f}" y2="{y:.1f}"/>')
            parts.append(f'<text class="end" x="{LEFT - 8}" y="{y:.1f}" dy="0.35em">{_tick_text(tick)}</text>')
        for tick in _round_ticks(self.start, self.end, 8):
            if self.start <= tick <= self.end:
                parts.append(f'<text x="{self.x(tick):.1f}" y="{HEIGHT - BOTTOM + 18}">{tick:g}</text>')
        middle = (LEFT + WIDTH - RIGHT) / 2
        parts.append(f'<text x="{middle:.1f}" y="{HEIGHT - 4}">seconds since the first scan</text>')
        scale = "position error, logarithmic" if self.log else "position error"
        return "".join(parts) + f'<text class="begin" x="{LEFT}" y="12">{scale}</text>'

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


def _round_ticks(low: float, high: float, count: int) -> list[float]:
    """About `count` round steps from at or below `low` to at or above `high`."""
    rough = max(high - low, 1e-9) / count
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(s * power for s in (1, 2, 5, 10) if s * power >= rough * 0.999)
    first, last = math.floor(low / step), math.ceil(high / step - 1e-9)
    return [k * step for k in range(first, max(last, first + 1) + 1)]


def _tick_text(value: float) -> str:
    if value == 0:
        return "0"
    for unit, size in (("m", 1.0), ("cm", 0.01)):
        if value >= size * 0.999:
            return f"{value / size:g} {unit}"
    return f"{value * 1000:g} mm"
