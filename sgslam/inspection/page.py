"""`inspection.html`: what was found in a building's plan, on its storeys' plans and in tables."""

import math
from collections.abc import Iterator
from statistics import median_high

from data import Floor
from matching.ambiguity.self_similarity import Likeness
from sgslam.inspection.inspection import Inspection, RoomInspection
from sgslam.inspection.plan_svg import heat_legend, short, storey_svg
from sgslam.report.html_page import TEMPLATES
from sgslam.report.number_formats import NOTHING


def inspection_html(inspection: Inspection, name: str) -> str:
    """The page; `name` is the building's. All strings from data are escaped."""
    return TEMPLATES.get_template("inspection/inspection.html").render(
        name=name, tiles=_tiles(inspection), gaps=_gap_rows(inspection), legend=heat_legend(),
        twins=[_twin_row(inspection, like) for like in inspection.storey_twins], storeys=_storeys(inspection),
    )  # fmt: skip


def _storeys(inspection: Inspection) -> Iterator[tuple[str, str, list[list[str]]]]:
    """Name, SVG, and rows of the table of rooms of each storey that is not empty, the highest first."""
    floors = [*inspection.graph.floors]
    known = {f.id for f in floors}
    others = dict.fromkeys(w.floor for w in inspection.graph.wall_surfaces if w.floor not in known)
    floors += [Floor(f or "", f or "no storey") for f in others]
    for floor in reversed(floors):
        of = floor.id or None
        if svg := storey_svg(inspection, of):
            yield _storey_name(inspection, of), svg, _room_rows(inspection, of)


def _tiles(inspection: Inspection) -> dict[str, int | str]:
    graph, found = inspection.graph, [r.needed for r in inspection.rooms.values()]
    known = [n.rooms for n in found if n.rooms is not None]
    told = sum(n.outcome == "never" for n in found)
    return {
        "storeys": len(graph.floors), "rooms": len(graph.rooms), "wall surfaces": len(graph.wall_surfaces),
        "doors": len(graph.doors), "rooms to be seen, median": median_high(known) if known else NOTHING,
        "at the most": max(known, default=NOTHING), "start rooms that never do": told,
    }  # fmt: skip


def _gap_rows(inspection: Inspection) -> list[list[str]]:
    rows = [["the whole model", "notice", notice, ""] for notice in inspection.notices]
    return rows + [[_storey_name(inspection, g.floor), g.kind, g.told, str(len(g.ids) or "")] for g in inspection.gaps]


def _room_rows(inspection: Inspection, floor: str | None) -> list[list[str]]:
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
    return rows


def _alone(inspection: Inspection, found: RoomInspection, most: int = 4) -> str:
    names = list(dict.fromkeys(_place(inspection, like) for like in found.alone))
    return (", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")) or NOTHING


def _place(inspection: Inspection, like: Likeness) -> str:
    other = like.others[0]
    if other == like.rooms[0]:
        return f"itself, turned by {_degrees(like.turned)}"
    return inspection.graph.room_by_id[other].name or other if other else "a place that is no room"


def _twin_row(inspection: Inspection, like: Likeness) -> list[str]:
    here = _floor_of(inspection, like)
    other = "itself" if like.floor == here else _storey_name(inspection, like.floor)
    return [_storey_name(inspection, here), f"{other}, turned by {_degrees(like.turned)}", f"{like.nats:.1f} nats"]


def _floor_of(inspection: Inspection, like: Likeness) -> str | None:
    found = inspection.rooms.get(like.rooms[0])
    return found.needed.floor if found else None


def _storey_name(inspection: Inspection, floor: str | None) -> str:
    known = {f.id: f.name or f.id for f in inspection.graph.floors}
    return known.get(floor, floor) if floor is not None else "the whole model"


def _degrees(turned: float) -> str:
    return f"{round(math.degrees(turned)) % 360}°"
