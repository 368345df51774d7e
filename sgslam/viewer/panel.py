"""The control panel of the page: the run's status, layers, match hypotheses and the error chart."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sgslam.session import Snapshot
from sgslam.viewer.page import Page
from sgslam.viewer.scene import GHOSTS, LAYERS, ROOMS, RunScene

Floats = NDArray[np.float64]
ALL = "all storeys"
HIGHEST = 6.0  # m, largest lift of the map above the plan
SMALLEST_M = 1e-3  # lower end of the chart's axis
SAMPLES = 400  # per line of the chart


class Panel:
    """The controls of a `RunScene`."""

    def __init__(self, page: Page, scene: RunScene) -> None:
        self._page, self._scene = page, scene
        self._now: Snapshot | None = None
        gui = page.server.gui
        self.status = gui.add_markdown("waiting for the first scan")
        self.storey = gui.add_dropdown("storey", [ALL], initial_value=ALL)
        with gui.add_folder("match hypotheses", visible=False) as self._places:
            self._hypotheses = gui.add_markdown("")
        with gui.add_folder("error against ground truth (m)", visible=False) as self._errors:
            self.chart: Any = None
        with gui.add_folder("shown", expand_by_default=False):
            for layer, text in LAYERS.items():
                self._switch(layer, text)
            self.lift = gui.add_slider("map over plan (m)", 0.0, HIGHEST, 0.1, 0.0)
        self.storey.on_update(lambda _: self._choose())
        self.lift.on_update(lambda _: self.lift_map(float(self.lift.value)))

    def _switch(self, layer: str, text: str) -> None:
        box = self._page.server.gui.add_checkbox(text, True)
        box.on_update(lambda _: self._scene.show_layer(layer, box.value))

    def _choose(self) -> None:
        of = {name: own for own, name in self._scene.storeys.items()}
        self._scene.show_storey(of.get(self.storey.value))

    def lift_map(self, metres: float) -> None:
        """Lifts the map above its place in the plan; the match lines then lead down to the plan."""
        self._scene.lift = metres
        if self._now is not None:
            with self._page.atomic():
                self._scene.place(self._now)

    def show_status(self, now: Snapshot, heading: str, facts: Sequence[str]) -> None:
        """Shows the status: `heading` and below it `facts`, line by line."""
        self._now = now
        names = [ALL, *self._scene.storeys.values()]
        if list(self.storey.options) != names:
            chosen = self.storey.value
            self.storey.options = names
            self.storey.value = chosen if chosen in names else ALL
        _set(self.status, f"**{heading}**\n\n" + "\n\n".join(_plain(fact) for fact in facts if fact))
        ambiguous = bool(now.hypotheses) and now.T_plan_map is None
        if self._places.visible != ambiguous:
            self._places.visible = ambiguous
        if ambiguous:
            _set(self._hypotheses, hypothesis_table(now, self._scene.storeys))

    def draw_errors(self, seconds: Floats, lines: dict[str, Floats]) -> None:
        """Draws errors (N,) in metres by name, at `seconds` (N,) after the first scan; NaN where unknown."""
        from viser import uplot

        if not len(seconds):
            return
        chosen = np.unique(np.linspace(0, len(seconds) - 1, min(len(seconds), SAMPLES)).round().astype(int))
        data = (seconds[chosen], *(np.maximum(line[chosen], SMALLEST_M) for line in lines.values()))
        if self.chart is None:
            self._errors.visible = True
            with self._errors:
                self.chart = self._page.server.gui.add_uplot(
                    data,
                    (
                        uplot.Series(label="seconds"),
                        *(uplot.Series(label=text, stroke=ROOMS[k], width=2) for k, text in enumerate(lines)),
                    ),
                    scales={"x": uplot.Scale(time=False), "y": uplot.Scale(distr=3)},
                    aspect=1.6,
                )
        else:
            self.chart.data = data


def hypothesis_table(now: Snapshot, storeys: dict[str, str]) -> str:
    """Markdown table of the match hypotheses: probability among those listed, storey, score and rooms.

    The probability is exp(score) over the sum of all: the scores are log likelihood ratios.
    """
    hypotheses = [hypothesis for _, hypothesis in now.hypotheses]
    scores = np.array([float(h["score"]) for h in hypotheses])
    shares = np.exp(scores - scores.max())
    rows = ["| | probability | storey | score | rooms |", "|---|---|---|---|---|"]
    for number, (h, share) in enumerate(zip(hypotheses, shares / shares.sum(), strict=True)):
        dot = f'<span style="color:{ROOMS[number]}">■</span>' if number < GHOSTS else ""
        storey = _plain(storeys.get(str(h.get("floor")), "the plan"))
        rooms = len({a for _, a in h.get("rooms") or ()})
        rows.append(f"| {dot} {number + 1} | {100 * share:.0f} % | {storey} | {float(h['score']):.1f} | {rooms} |")
    return "\n".join(rows)


def _plain(text: str) -> str:
    """The text with all Markdown characters escaped."""
    return "".join("\\" + c if c in "\\`*_{}[]<>#|!~$" else c for c in text)


def _set(handle: Any, text: str) -> None:
    if handle.content != text:
        handle.content = text
