"""The plan of a storey: rooms coloured by how many must be seen from there, walls, doors and connections."""

from html import escape

import numpy as np

from data import Room, SceneGraph
from matching.ambiguity.rooms_to_localise import RoomsToLocalise
from sgslam.inspection.inspection import Inspection
from sgslam.report.plan_drawing import DrawnRoom, PlanDrawing, planned_wall
from sgslam.report.plan_svg import Pen, scale_bar, view_box

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
    walls = tuple(planned_wall(w) for w in part.wall_surfaces)
    rooms = tuple(_drawn(r) for r in part.rooms)
    if not walls and not rooms:
        return ""
    drawing = PlanDrawing("", walls, rooms, (), (), np.empty((0, 2, 2)), {}, np.empty((0, 3)), 0.0, {})
    pen = Pen(drawing.centre())
    margin, (left, top, width, height) = view_box(drawing, pen)
    found = {r.id: inspection.rooms[r.id].to_localise if r.id in inspection.rooms else None for r in part.rooms}
    fills = "".join(_fill(pen, room, drawn, found[room.id]) for room, drawn in zip(part.rooms, rooms, strict=True))
    in_rooms = {w.id for w in part.wall_surfaces if w.room is not None}
    groups = {
        "heat": fills,
        "bim-walls": "".join(pen.line(w.ends, w.title) for w in walls if w.id in in_rooms),
        "walls-unmatched": "".join(pen.line(w.ends, w.title) for w in walls if w.id not in in_rooms),
        "links": _links(pen, part),
        "doors": "".join(
            pen.line(np.array([d.centroid] * 2), d.id, "" if len(d.rooms) > 1 else ' class="outer"') for d in part.doors
        ),
        "names": "".join(
            _text(pen, drawn, room_count_text(found[r.id])) for r, drawn in zip(part.rooms, rooms, strict=True)
        ),
    }
    body = "".join(f'<g class="layer-{name}">{content}</g>' for name, content in groups.items())
    scale = scale_bar(left + 0.4 * margin, top + height - 0.4 * margin, width)
    box = f"{left:.3f} {top:.3f} {width:.3f} {height:.3f}"
    return f'<svg class="storey" viewBox="{box}" role="img" aria-label="plan of a storey">{body}{scale}</svg>'


def heat_legend() -> str:
    """What the colours mean."""
    bounds = list(zip((0, *STEPS), STEPS, strict=False))
    labels = [str(high) if high == low + 1 else f"{low + 1} to {high}" for low, high in bounds]
    named = {str(n): label for n, label in enumerate([*labels, f"over {STEPS[-1]}"], 1)}
    named |= {NEVER: "never: ambiguous", "lost": "not found", UNKNOWN: "no walls"}
    keys = "".join(
        f'<span><svg class="key" viewBox="0 0 24 10"><g class="layer-heat">'
        f'<polygon class="heat-{name}" points="1,1 23,1 23,9 1,9"/></g></svg>{label}</span>'
        for name, label in named.items()
    )
    return f'<div class="legend"><span>Rooms to localise from here:</span>{keys}</div>'


def _drawn(room: Room) -> DrawnRoom:
    outline = np.array(room.polygon) if len(room.polygon or ()) > 2 else None
    return DrawnRoom(outline, np.array(room.centroid), room.name or room.id, False, "")


def _fill(pen: Pen, room: Room, drawn: DrawnRoom, found: RoomsToLocalise | None) -> str:
    title = f"{drawn.name}: {room_count_text(found) or 'no walls'}"
    if drawn.outline is None:
        return pen.line(np.array([room.centroid] * 2), title, f' class="heat-{heat(found)}"')
    outline = pen.points(drawn.outline)
    return f'<polygon class="heat-{heat(found)}" points="{outline}"><title>{escape(title)}</title></polygon>'


def _links(pen: Pen, part: SceneGraph) -> str:
    """Lines from each door to the centroids of its rooms."""
    at = {r.id: r.centroid for r in part.rooms}
    ends = [np.array([d.centroid, at[room]]) for d in part.doors for room in d.rooms if room in at]
    return "".join(pen.line(line) for line in ends)


def _text(pen: Pen, room: DrawnRoom, number: str) -> str:
    x, y = pen.points(room.label).split(",")
    size = room.text_size()
    name = f'<text x="{x}" y="{y}" dy="1.2em" font-size="{size:.2f}">{escape(room.name)}</text>'
    big = min(3.0 * size, LARGEST_COUNT_M)
    return f'<text class="count" x="{x}" y="{y}" dy="-0.05em" font-size="{big:.2f}">{number}</text>{name}'
