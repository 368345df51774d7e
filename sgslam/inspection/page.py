"""`inspection.html`: what was found in a building's plan, on its storeys' plans and in tables."""

import math
from html import escape
from statistics import median_high

from data import Floor
from sgslam.inspection.inspection import Inspection, RoomInspection
from sgslam.inspection.plan_svg import heat_legend, short, storey_svg
from sgslam.inspection.self_similarity import Likeness
from sgslam.report.html_page import page
from sgslam.report.html_parts import NOTHING, card, table

STYLES = ("report.css", "inspection.css")


def inspection_html(inspection: Inspection, name: str) -> str:
    """The page; `name` is the building's. All strings from data are escaped."""
    parts = [f"<header><h1>{escape(name)}</h1></header>", _tiles(inspection), _lacks(inspection), _twins(inspection)]
    floors = [*inspection.graph.floors]
    known = {f.id for f in floors}
    others = dict.fromkeys(w.floor for w in inspection.graph.wall_surfaces if w.floor not in known)
    floors += [Floor(f or "", f or "no storey") for f in others]
    for floor in reversed(floors):  # the highest first, as the building stands
        of = floor.id or None
        if svg := storey_svg(inspection, of):
            parts.append(card(_storey_name(inspection, of), svg + heat_legend() + _rooms(inspection, of), NOTE))
    return page(f"Inspection of {name}", "\n".join(parts), STYLES)


NOTE = (
    "The number in a room: how many rooms, that one among them, a robot that starts there and goes on to the nearest "
    "ones must see until, in most maps with the noise of real scans, its place is the only one that explains the map. "
    "Dots are doors, pale ones lead out; dotted lines go to the rooms that they join; walls of another colour are in "
    "no room."
)


def _tiles(inspection: Inspection) -> str:
    graph, found = inspection.graph, [r.needed for r in inspection.rooms.values()]
    known = [n.rooms for n in found if n.rooms is not None]
    told = sum(n.outcome == "never" for n in found)
    tiles = {
        "storeys": len(graph.floors), "rooms": len(graph.rooms), "wall surfaces": len(graph.wall_surfaces),
        "doors": len(graph.doors), "rooms to be seen, median": median_high(known) if known else NOTHING,
        "at the most": max(known, default=NOTHING), "start rooms that never do": told,
    }  # fmt: skip
    inner = "".join(f'<div class="tile"><b>{value}</b><span>{label}</span></div>' for label, value in tiles.items())
    return f'<div class="tiles">{inner}</div>'


def _lacks(inspection: Inspection) -> str:
    rows = [["the whole model", "notice", notice, ""] for notice in inspection.notices]
    rows += [[_storey_name(inspection, g.floor), g.kind, g.told, str(len(g.ids) or "")] for g in inspection.gaps]
    content = table(["where", "kind", "what", "how many"], rows, 3) if rows else "<p>Nothing that we look for.</p>"
    return card("What the model lacks", content)


def _twins(inspection: Inspection) -> str:
    rows = [
        [_storey_name(inspection, _floor_of(inspection, t)), *_likeness(inspection, t)] for t in inspection.storey_twins
    ]
    content = table(["storey", "could as well be", "evidence against it"], rows, 2) if rows else (
        "<p>No storey, seen as a whole, could be taken for another or for itself turned.</p>"
    )  # fmt: skip
    note = "Even a perfect map of the whole storey fits there; below 5.3 nats nobody can be 99.5 % sure."
    return card("Where the building is its own twin", content, note if rows else "")


def _rooms(inspection: Inspection, floor: str | None) -> str:
    graph = inspection.graph
    doors = [room for d in graph.doors for room in d.rooms]
    rows = []
    for room, found in inspection.rooms.items():
        if found.needed.floor != floor:
            continue
        n = found.needed
        each = ", ".join(f"{rooms}: {known} of {of}" for rooms, known, of in n.asked[-2:]) or NOTHING
        counts = [str(len(graph.surfaces_of_room[room])), str(doors.count(room))]
        reach = f"{n.by_doors} of {n.reachable}"
        name = graph.room_by_id[room].name or room
        rows.append([name, _alone(inspection, found), *counts, reach, each, short(n) or NOTHING])
    if not rows:
        return ""
    head = ["room", "seen alone, looks like", "walls", "doors", "reached by doors", "known maps", "rooms to be seen"]
    return table(head, rows, 2)


def _alone(inspection: Inspection, found: RoomInspection, most: int = 4) -> str:
    names = list(dict.fromkeys(_place(inspection, like) for like in found.alone))
    return (", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")) or NOTHING


def _place(inspection: Inspection, like: Likeness) -> str:
    other = like.others[0]
    if other == like.rooms[0]:
        return f"itself, turned by {_degrees(like.turned)}"
    return inspection.graph.room_by_id[other].name or other if other else "a place that is no room"


def _likeness(inspection: Inspection, like: Likeness) -> list[str]:
    here = _floor_of(inspection, like)
    other = "itself" if like.floor == here else _storey_name(inspection, like.floor)
    return [f"{other}, turned by {_degrees(like.turned)}", f"{like.nats:.1f} nats"]


def _floor_of(inspection: Inspection, like: Likeness) -> str | None:
    found = inspection.rooms.get(like.rooms[0])
    return found.needed.floor if found else None


def _storey_name(inspection: Inspection, floor: str | None) -> str:
    known = {f.id: f.name or f.id for f in inspection.graph.floors}
    return known.get(floor, floor) if floor is not None else "the whole model"


def _degrees(turned: float) -> str:
    return f"{round(math.degrees(turned)) % 360}°"
