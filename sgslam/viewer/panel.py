"""The page of a run: its scene, and a control panel with status, layers and match hypotheses."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from sgslam.report.contents import DRAWN_HYPOTHESES
from sgslam.report.tables import hypothesis_rows
from sgslam.session import Snapshot
from sgslam.viewer.page import Page
from sgslam.viewer.scene import LAYERS, ROOMS, RunScene

ALL = "all storeys"


class Panel:
    """The controls of a `RunScene`."""

    def __init__(self, page: Page) -> None:
        self._page, self.scene = page, RunScene(page)
        self._now: Snapshot | None = None
        gui = page.server.gui
        self.status = gui.add_markdown("waiting for the first scan")
        self.storey = gui.add_dropdown("storey", [ALL], initial_value=ALL)
        with gui.add_folder("match hypotheses", visible=False) as self._places:
            self._hypotheses = gui.add_markdown("")
        with gui.add_folder("shown", expand_by_default=False):
            for layer in LAYERS:
                self._switch(layer)
            self.lift = gui.add_slider("map over plan (m)", 0.0, 6.0, 0.1, 0.0)
        self.storey.on_update(lambda _: self._choose())
        self.lift.on_update(lambda _: self.lift_map(float(self.lift.value)))

    def _switch(self, layer: str) -> None:
        box = self._page.server.gui.add_checkbox(layer, True)
        box.on_update(lambda _: self.scene.show_layer(layer, box.value))

    def _choose(self) -> None:
        of = {name: own for own, name in self.scene.storeys.items()}
        self.scene.show_storey(of.get(self.storey.value))

    def lift_map(self, metres: float) -> None:
        """Lifts the map above its place in the plan; the match lines then lead down to the plan."""
        self.scene.lift = metres
        if self._now is not None:
            with self._page.atomic():
                self.scene.place(self._now)

    def set_camera(self, now: Snapshot | None = None) -> None:
        """Points the camera at the plan and the map, from the south and above."""
        everything = self.scene.extent(now)
        if not len(everything):
            return
        low, high = everything.min(axis=0), everything.max(axis=0)
        if now is None:
            low[0] -= (high - low)[:2].max() / 2  # room for the map beside the plan
        size = max(float((high - low)[:2].max()), 4.0)
        middle = (low + high) / 2 + size * np.array([0.2, -0.05, 0.0])
        self._page.set_camera(middle, middle + size * np.array([0.0, -0.5, 0.6]))

    def show(self, now: Snapshot, heading: str, scans: int, facts: Sequence[str] = ()) -> None:
        """Shows the status, a `heading` and further lines."""
        self._now = now
        names = [ALL, *self.scene.storeys.values()]
        if list(self.storey.options) != names:
            chosen = self.storey.value
            self.storey.options = names
            self.storey.value = chosen if chosen in names else ALL
        rooms, walls = (sum(len(getattr(g, kind)) for g in now.graphs) for kind in ("rooms", "wall_surfaces"))
        counts = [f"{scans} scans, {len(now.poses)} keyframes", f"{rooms} rooms, {walls} wall surfaces"]
        lines = [now.reason, *counts, *facts]
        _set(self.status, f"**{heading}**\n\n" + "\n\n".join(_plain(line) for line in lines if line))
        ambiguous = bool(now.hypotheses) and now.T_plan_map is None
        if self._places.visible != ambiguous:
            self._places.visible = ambiguous
        if ambiguous:
            _set(self._hypotheses, hypothesis_table(now, self.scene.storeys))


def hypothesis_table(now: Snapshot, storeys: dict[str, str]) -> str:
    """Markdown table of the match hypotheses: probability, storey, score and rooms."""
    rows = ["| | probability | storey | score | rooms |", "|---|---|---|---|---|"]
    found = hypothesis_rows([hypothesis for _, hypothesis in now.hypotheses], storeys)
    for number, (storey, probability, score, _, rooms) in enumerate(found):
        dot = f'<span style="color:{ROOMS[number]}">■</span>' if number < DRAWN_HYPOTHESES else ""
        rows.append(f"| {dot} {number + 1} | {probability} | {_plain(storey)} | {score} | {rooms} |")
    return "\n".join(rows)


def _plain(text: str) -> str:
    """The text with all Markdown characters escaped."""
    return "".join("\\" + c if c in "\\`*_{}[]<>#|!~$" else c for c in text)


def _set(handle: Any, text: str) -> None:
    if handle.content != text:
        handle.content = text
