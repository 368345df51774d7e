"""A storey's A-graph from above: rooms coloured by how many must be seen from there, walls, doors, what joins what."""

from html import escape

import numpy as np

from data import Room, SceneGraph
from matching.ambiguity.rooms_to_localise import RoomsNeeded
from sgslam.inspection.inspection import Inspection
from sgslam.report.plan_drawing import DrawnRoom, PlanDrawing, planned_wall
from sgslam.report.plan_svg import Pen, scale_bar, view_box

STEPS = (1, 2, 3, 4, 6, 9)  # rooms needed up to which each colour goes; one more beyond
LARGEST_COUNT_M = 0.9  # of the numbers in the rooms
NEVER, UNKNOWN = "never", "none"


def heat(needed: RoomsNeeded | None) -> str:
    """The name of a room's colour."""
    if needed is None or needed.outcome == "nothing to see":
        return UNKNOWN
    if needed.rooms is None:
        return NEVER if needed.outcome == "never" else "lost"
    return str(sum(needed.rooms > step for step in STEPS) + 1)


def short(needed: RoomsNeeded | None) -> str:
    """What stands in the room."""
    if needed is None or needed.outcome == "nothing to see":
        return ""
    return str(needed.rooms) if needed.rooms is not None else NEVER if needed.outcome == "never" else "?"


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
    found = {r.id: inspection.rooms[r.id].needed if r.id in inspection.rooms else None for r in part.rooms}
    fills = "".join(_fill(pen, room, drawn, found[room.id]) for room, drawn in zip(part.rooms, rooms, strict=True))
    housed = {w.id for w in part.wall_surfaces if w.room is not None}
    groups = {
        "heat": fills,
        "bim-walls": "".join(pen.line(w.ends, w.title) for w in walls if w.id in housed),
        "walls-unmatched": "".join(pen.line(w.ends, w.title) for w in walls if w.id not in housed),
        "links": _links(pen, part),
        "doors": "".join(
            pen.line(np.array([d.centroid] * 2), d.id, "" if len(d.rooms) > 1 else ' class="outer"') for d in part.doors
        ),
        "names": "".join(_text(pen, drawn, short(found[r.id])) for r, drawn in zip(part.rooms, rooms, strict=True)),
    }
    body = "".join(f'<g class="layer-{name}">{content}</g>' for name, content in groups.items())
    scale = scale_bar(left + 0.4 * margin, top + height - 0.4 * margin, width)
    box = f"{left:.3f} {top:.3f} {width:.3f} {height:.3f}"
    return f'<svg class="storey" viewBox="{box}" role="img" aria-label="plan of a storey">{body}{scale}</svg>'


def heat_legend() -> str:
    """The colours, and what they say."""
    bounds = list(zip((0, *STEPS), STEPS, strict=False))
    labels = [str(high) if high == low + 1 else f"{low + 1} to {high}" for low, high in bounds]
    named = {str(n): label for n, label in enumerate([*labels, f"over {STEPS[-1]}"], 1)}
    named |= {NEVER: "never: a twin", "lost": "not found", UNKNOWN: "nothing to see"}
    keys = "".join(
        f'<span><svg class="key" viewBox="0 0 24 10"><g class="layer-heat">'
        f'<polygon class="heat-{name}" points="1,1 23,1 23,9 1,9"/></g></svg>{label}</span>'
        for name, label in named.items()
    )
    return f'<div class="legend"><span>Rooms to be seen from here:</span>{keys}</div>'


def _drawn(room: Room) -> DrawnRoom:
    outline = np.array(room.polygon) if len(room.polygon or ()) > 2 else None
    return DrawnRoom(outline, np.array(room.centroid), room.name or room.id, False, "")


def _fill(pen: Pen, room: Room, drawn: DrawnRoom, needed: RoomsNeeded | None) -> str:
    told = f"{drawn.name}: {short(needed) or 'nothing to see'}"
    if drawn.outline is None:
        return pen.line(np.array([room.centroid] * 2), told, f' class="heat-{heat(needed)}"')
    outline = pen.points(drawn.outline)
    return f'<polygon class="heat-{heat(needed)}" points="{outline}"><title>{escape(told)}</title></polygon>'


def _links(pen: Pen, part: SceneGraph) -> str:
    """From each door to the middles of the rooms that it joins."""
    at = {r.id: r.centroid for r in part.rooms}
    ends = [np.array([d.centroid, at[room]]) for d in part.doors for room in d.rooms if room in at]
    return "".join(pen.line(line) for line in ends)


def _text(pen: Pen, room: DrawnRoom, number: str) -> str:
    x, y = pen.points(room.label).split(",")
    size = room.text_size()
    name = f'<text x="{x}" y="{y}" dy="1.2em" font-size="{size:.2f}">{escape(room.name)}</text>'
    big = min(3.0 * size, LARGEST_COUNT_M)
    return f'<text class="count" x="{x}" y="{y}" dy="-0.05em" font-size="{big:.2f}">{number}</text>{name}'
