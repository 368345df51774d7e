"""`inspection.html`: the inspection of a plan as a page. In the plan of each storey rooms are coloured by how many must
be seen from there."""

import math
from collections.abc import Iterator
from dataclasses import replace
from statistics import median_high

import numpy as np

from data import Floor
from data.scene_graph import Xy
from matching.ambiguity.rooms_to_localise import RoomsToLocalise
from matching.ambiguity.symmetries import SimilarPlace
from sgslam.inspection.inspection import Inspection, RoomInspection
from sgslam.report.drawn_paths import Mark
from sgslam.report.html_page import TEMPLATES
from sgslam.report.number_formats import NOTHING
from sgslam.report.plan_drawing import Name, PlanDrawing, room_marks, room_name, wall_mark
from sgslam.report.plan_svg import plan_svg

STEPS = (1, 2, 3, 4, 6, 9)  # highest number of rooms of each colour; one more colour beyond
NEVER, UNKNOWN = "never", "none"


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
    bounds = list(zip((0, *STEPS), STEPS, strict=False))
    labels = [str(high) if high == low + 1 else f"{low + 1} to {high}" for low, high in bounds]
    named = {str(n): label for n, label in enumerate([*labels, f"over {STEPS[-1]}"], 1)}
    return named | {NEVER: "never: ambiguous", "lost": "not found", UNKNOWN: "no walls"}
