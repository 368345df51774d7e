"""`inspection.html`: the inspection of a plan as a page, with the plan of each storey."""

import math
from collections.abc import Iterator
from statistics import median_high

from data import Floor
from matching.ambiguity.symmetries import SimilarPlace
from sgslam.inspection.inspection import Inspection, RoomInspection
from sgslam.inspection.plan_svg import heat, heat_labels, storey_svg
from sgslam.report.html_page import TEMPLATES
from sgslam.report.number_formats import NOTHING


def inspection_html(inspection: Inspection, name: str) -> str:
    """The page; `name` is the building's. All strings from data are escaped."""
    return TEMPLATES.get_template("inspection/inspection.html").render(
        name=name,
        tiles=key_figures(inspection),
        issues=_issue_rows(inspection),
        storeys=_storeys(inspection),
        similar_storeys=[_storey_row(inspection, place) for place in inspection.similar_storeys],
        legend=heat_labels(),
    )


def _storeys(inspection: Inspection) -> Iterator[tuple[str, str, list[list[str]]]]:
    """Name, SVG and rows of the room table of each storey that is not empty, the highest first."""
    floors = [*inspection.graph.floors]
    known = {f.id for f in floors}
    others = dict.fromkeys(w.floor for w in inspection.graph.wall_surfaces if w.floor not in known)
    floors += [Floor(f or "", f or "no storey") for f in others]
    for floor in reversed(floors):
        floor_id = floor.id or None
        if svg := storey_svg(inspection, floor_id):
            yield _storey_name(inspection, floor_id), svg, _room_rows(inspection, floor_id)


def key_figures(inspection: Inspection) -> dict[str, int | str]:
    """Values by their names, of the whole plan."""
    graph, found = inspection.graph, [r.to_localise for r in inspection.rooms.values()]
    counts = [n.rooms for n in found if n.rooms is not None]
    return {
        "storeys": len(graph.floors),
        "rooms": len(graph.rooms),
        "wall surfaces": len(graph.wall_surfaces),
        "walls that bound no room": sum(inspection.counts(f.id)["walls_without_room"] for f in graph.floors),
        "doors": len(graph.doors),
        "rooms to localise, median": median_high(counts) if counts else NOTHING,
        "rooms to localise, maximum": max(counts, default=NOTHING),
        "start rooms that stay ambiguous": sum(n.outcome == "never" for n in found),
        "start rooms that are not found": sum(n.outcome == "not found" for n in found),
    }


def _issue_rows(inspection: Inspection) -> list[list[str]]:
    rows = [["the whole model", "notice", notice, ""] for notice in inspection.notices]
    return rows + [
        [_storey_name(inspection, i.floor), i.kind, i.message, str(len(i.ids) or "")] for i in inspection.issues
    ]


def _room_rows(inspection: Inspection, floor: str | None) -> list[list[str]]:
    graph = inspection.graph
    doors = [room for d in graph.doors for room in d.rooms]
    rows = []
    for room, found in inspection.rooms.items():
        n = found.to_localise
        if n.floor != floor:
            continue
        trials = ", ".join(f"{rooms}: {localised} of {total}" for rooms, localised, total in n.trials[-2:]) or NOTHING
        counts = [str(len(graph.surfaces_of_room[room])), str(doors.count(room))]
        reach = f"{n.by_doors} of {n.reachable}"
        name = graph.room_by_id[room].name or room
        similar = _similar_places(inspection, found)
        rows.append([name, similar, *counts, reach, trials, heat(n)[1] or NOTHING])
    return rows


def _similar_places(inspection: Inspection, found: RoomInspection, most: int = 4) -> str:
    names = list(dict.fromkeys(_place_name(inspection, place) for place in found.similar_places))
    return (", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")) or NOTHING


def _place_name(inspection: Inspection, place: SimilarPlace) -> str:
    other = place.counterparts[0]
    if other == place.rooms[0]:
        return f"itself, rotated by {_degrees(place.rotation)}"
    return inspection.graph.room_by_id[other].name or other if other else "a place outside any room"


def _storey_row(inspection: Inspection, place: SimilarPlace) -> list[str]:
    room = inspection.rooms.get(place.rooms[0])
    own = room.to_localise.floor if room else None
    other = "itself" if place.floor == own else _storey_name(inspection, place.floor)
    return [_storey_name(inspection, own), f"{other}, rotated by {_degrees(place.rotation)}", f"{place.nats:.1f} nats"]


def _storey_name(inspection: Inspection, floor: str | None) -> str:
    known = {f.id: f.name or f.id for f in inspection.graph.floors}
    return known.get(floor, floor) if floor is not None else "the whole model"


def _degrees(radians: float) -> str:
    return f"{round(math.degrees(radians)) % 360}°"
