"""The plan of a storey: rooms coloured by how many must be seen from there, walls, doors and connections."""

import numpy as np

from matching.ambiguity.rooms_to_localise import RoomsToLocalise
from sgslam.inspection.inspection import Inspection
from sgslam.report.plan_drawing import DrawnRoom, Layers, Mark, PlanDrawing, planned_room, planned_wall
from sgslam.report.plan_svg import Pen, svg_figure

STEPS = (1, 2, 3, 4, 6, 9)  # highest number of rooms of each colour; one more colour beyond
LARGEST_COUNT_M = 0.9  # text height of the numbers in the rooms
NEVER, UNKNOWN = "never", "none"


def heat(found: RoomsToLocalise | None) -> str:
    """The name of a room's colour, as in the style sheet."""
    if found is None or found.outcome == "no walls":
        return UNKNOWN
    if found.rooms is None:
        return NEVER if found.outcome == "never" else "lost"
    return str(sum(found.rooms > step for step in STEPS) + 1)


def room_count_text(found: RoomsToLocalise | None) -> str:
    """The number that is drawn in the room, or a word for why there is none."""
    if found is None or found.outcome == "no walls":
        return ""
    return str(found.rooms) if found.rooms is not None else NEVER if found.outcome == "never" else "?"


def storey_svg(inspection: Inspection, floor: str | None) -> str:
    """The SVG of one storey; empty where there is nothing on it."""
    part = inspection.graph.on_floor(floor)
    drawing = PlanDrawing("", tuple(map(planned_wall, part.wall_surfaces)), tuple(map(planned_room, part.rooms)))
    if not drawing.bim_walls and not drawing.bim_rooms:
        return ""
    pen = Pen(drawing.centre())
    found = {r.id: inspection.rooms[r.id].to_localise if r.id in inspection.rooms else None for r in part.rooms}
    rooms = list(zip(drawing.bim_rooms, found.values(), strict=True))
    in_rooms = {w.id for w in part.wall_surfaces if w.room is not None}
    lines = {known: [Mark(w.ends, w.title) for w in drawing.bim_walls if (w.id in in_rooms) is known]
             for known in (True, False)}  # fmt: skip
    at = {r.id: r.centroid for r in part.rooms}
    layers: Layers = [
        ("heat", [_fill(room, n) for room, n in rooms]), ("bim-walls", lines[True]), ("walls-unmatched", lines[False]),
        ("links", [Mark(np.array([d.centroid, at[room]])) for d in part.doors for room in d.rooms if room in at]),
        ("doors", [Mark(np.array([d.centroid] * 2), d.id, looks=() if len(d.rooms) > 1 else ("outer",))
                   for d in part.doors]),
    ]  # fmt: skip
    counts = "".join(
        pen.text(r.label, room_count_text(n), min(3.0 * r.text_size(), LARGEST_COUNT_M), -0.05, "count")
        for r, n in rooms
    )
    groups = [*pen.groups(layers), ("names", counts + pen.names(drawing.bim_rooms, 1.2))]
    return svg_figure(groups, pen, drawing.bounds(), 'class="storey" role="img" aria-label="plan of a storey"')


def heat_labels() -> dict[str, str]:
    """What the colours mean."""
    bounds = list(zip((0, *STEPS), STEPS, strict=False))
    labels = [str(high) if high == low + 1 else f"{low + 1} to {high}" for low, high in bounds]
    named = {str(n): label for n, label in enumerate([*labels, f"over {STEPS[-1]}"], 1)}
    return named | {NEVER: "never: ambiguous", "lost": "not found", UNKNOWN: "no walls"}


def _fill(room: DrawnRoom, found: RoomsToLocalise | None) -> Mark:
    """The area of a room, or a dot where its outline is not known."""
    title, looks = f"{room.name}: {room_count_text(found) or 'no walls'}", (f"heat-{heat(found)}",)
    if room.outline is None:
        return Mark(np.array([room.label] * 2), title, looks=looks)
    return Mark(room.outline, title, True, looks)
