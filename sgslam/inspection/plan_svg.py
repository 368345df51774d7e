"""The plan of a storey: rooms coloured by how many must be seen from there, walls, doors and connections."""

from dataclasses import replace

import numpy as np

from data.scene_graph import Xy
from matching.ambiguity.rooms_to_localise import RoomsToLocalise
from sgslam.inspection.inspection import Inspection
from sgslam.report.drawn_paths import Mark
from sgslam.report.plan_drawing import Name, PlanDrawing, room_marks, room_name, wall_mark
from sgslam.report.plan_svg import plan_svg

STEPS = (1, 2, 3, 4, 6, 9)  # highest number of rooms of each colour; one more colour beyond
NEVER, UNKNOWN = "never", "none"


def heat(found: RoomsToLocalise | None) -> tuple[str, str]:
    """The name of a room's colour, as in the style sheet, and the number that is drawn in it, or why there is none."""
    if found is None or found.outcome == "no walls":
        return UNKNOWN, ""
    if found.rooms is None:
        return (NEVER, NEVER) if found.outcome == "never" else ("lost", "?")
    return str(sum(found.rooms > step for step in STEPS) + 1), str(found.rooms)


def storey_svg(inspection: Inspection, floor: str | None) -> str:
    """The SVG of one storey; empty where there is nothing on it."""
    part = inspection.graph.on_floor(floor)
    if not part.wall_surfaces and not part.rooms:
        return ""
    at = {r.id: r.centroid for r in part.rooms}
    heats, counts, names = [], [], []
    for room in part.rooms:
        found = inspection.rooms[room.id].to_localise if room.id in inspection.rooms else None
        (colour, text), name = heat(found), room_name(room, "names", 1.2)
        (area,) = room_marks([room]) or (_dot(room.centroid),)
        title = f"{name.text}: {text or 'no walls'}"
        heats.append(replace(area, title=title, looks=(f"heat-{colour}",)))
        names.append(name)
        counts.append(Name(text, name.place, 2.0 * name.size, "names", -0.05, "count"))
    lines: dict[bool, list[Mark]] = {True: [], False: []}
    for wall in part.wall_surfaces:
        lines[wall.room is not None].append(wall_mark(wall, f"{wall.id} {wall.source}"))
    links = [Mark(np.array([d.centroid, at[room]])) for d in part.doors for room in d.rooms if room in at]
    doors = [replace(_dot(d.centroid), title=d.id, looks=() if len(d.rooms) > 1 else ("outer",)) for d in part.doors]
    layers = {"heat": heats, "bim-walls": lines[True], "walls-unmatched": lines[False], "links": links, "doors": doors}
    return plan_svg(PlanDrawing("plan of a storey", layers, [*counts, *names]), 'class="storey"')


def _dot(place: Xy) -> Mark:
    return Mark(np.array([place, place]))


def heat_labels() -> dict[str, str]:
    """What the colours mean."""
    bounds = list(zip((0, *STEPS), STEPS, strict=False))
    labels = [str(high) if high == low + 1 else f"{low + 1} to {high}" for low, high in bounds]
    named = {str(n): label for n, label in enumerate([*labels, f"over {STEPS[-1]}"], 1)}
    return named | {NEVER: "never: ambiguous", "lost": "not found", UNKNOWN: "no walls"}
