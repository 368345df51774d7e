"""Checks the number of rooms that inspect-bim predicts to be needed, on the matching benchmark's maps.

Each start room is checked with pairs of the matching benchmark (regime `real`) that start there. The benchmark draws
its own noise and explores the nearest rooms first, as in the prediction, or rooms in any order. Each prediction is
checked on both sides: in the benchmark's first column with enough rooms, most pairs must be matched uniquely and
correctly; in the column before it, most must not. If a room is predicted to be never localised, most pairs of all rooms
must not be. Where about half of all maps are localised, the result is a matter of chance.
"""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd
from pydantic import BaseModel, NonNegativeInt, PositiveInt

from data import SceneGraph
from data.plans import load_bim
from data.synthetic_maps.exploration import Storey, Walk, storeys_of, walk
from data.synthetic_maps.noise_models import DrawnGraph, draw_walk
from data.synthetic_maps.walks import nearest_first
from evaluation.drives.buildings import demo_building
from evaluation.harness import Case, Options, Record, Study
from evaluation.matching_benchmark.judge import is_wrong
from evaluation.matching_benchmark.pairs import COLUMNS, truth_of
from matching import Matcher
from sgslam.inspection import InspectionSettings, inspect

DATA = "../shared/data"
CLEAR = 6  # pairs; a majority of this size ends the check
STREAM = 900_001  # of random numbers; not the index of a storey, so that inspect-bim never draws the same maps


class Choice(Options):
    """Which buildings, of which every `every`-th start room is checked with at most so many `pairs` on each side, drawn
    by `seed`. `maps` is the most maps of the same rooms that the inspection asks."""

    buildings: tuple[str, ...] = (
        "demo", *(f"{DATA}/ifc/{name}.ifc" for name in ("AC11-Institute-Var-2-IFC", "Office_A_20110811", "Jesse.1")),
        f"{DATA}/floorplans/swiss_floors/plan_1478.json",
    )  # fmt: skip
    order: Literal["near", "any"] = "near"
    every: PositiveInt = 1
    pairs: PositiveInt = 31
    maps: PositiveInt = 21
    seed: NonNegativeInt = 1  # the number of maps was chosen by pairs of seed 0


class BuildingCase(Case):
    """A building, a file or `demo`, and how it is checked."""

    building: str
    order: Literal["near", "any"]
    every: int
    pairs: int
    maps: int
    seed: int

    def files(self) -> set[str]:
        """The building's file."""
        return {self.building} - {"demo"}


class Side(BaseModel):
    """One side of a check: `rooms` seen (None: all), whether they are predicted to suffice, and in how many (`known`)
    `of` the pairs the learned matcher found the true place uniquely."""

    rooms: int | None
    predicted: bool
    known: int
    of: int

    @property
    def agrees(self) -> bool:
        """Whether most pairs are as predicted."""
        return (2 * self.known > self.of) == self.predicted


class Start(BaseModel):
    """A start room, the number of rooms that it is predicted to need (None: never localised), and its checks."""

    room: str
    needed: int | None
    sides: tuple[Side, ...]


class Starts(Record):
    """The start rooms of a building, in the plan's order."""

    starts: tuple[Start, ...]


def cases(options: Choice) -> list[BuildingCase]:
    """The buildings."""
    rest = options.model_dump(exclude={"buildings"})
    return [BuildingCase(building=building, **rest) for building in options.buildings]


def measure(case: BuildingCase, work: Path) -> Starts:
    """Inspects the building, and checks what is predicted for its start rooms."""
    graph = load_bim(demo_building(work) if case.building == "demo" else case.building).graph
    found, matcher = inspect(graph, settings=InspectionSettings(max_maps=case.maps)).rooms, Matcher.load()
    predicted = {room: of.to_localise for n, (room, of) in enumerate(found.items()) if n % case.every == 0}
    starts = []
    for place, storey in enumerate(storeys_of(graph)):
        for start, room in enumerate(storey.rooms):
            if room.id in predicted and predicted[room.id].outcome in ("known", "never"):
                draw, needed = partial(_draw, case, place, storey, start), predicted[room.id].rooms
                sides = [_side(graph, matcher, draw, case.pairs, *side) for side in sides_of(needed)]
                starts.append(Start(room=room.id, needed=needed, sides=tuple(sides)))
    return Starts(starts=tuple(starts))


def _side(
    graph: SceneGraph, matcher: Matcher, draw: Callable[[int | None, int], DrawnGraph], most: int, rooms: int | None,
    predicted: bool,
) -> Side:  # fmt: skip
    """Asks until a majority is clear or cannot be changed any more."""
    known = of = 0
    while of < most and abs(2 * known - of) < CLEAR and 2 * max(known, of - known) <= most:
        drawn = draw(rooms, of)
        answer = matcher.match(drawn.s_graph, graph)
        known += answer.status == "unique" and not is_wrong(answer, truth_of(drawn), False)
        of += 1
    return Side(rooms=rooms, predicted=predicted, known=known, of=of)


def _draw(case: BuildingCase, place: int, storey: Storey, start: int, rooms: int | None, index: int) -> DrawnGraph:
    """A map of so many rooms that begins in the room number `start` of the storey number `place`."""
    rng = np.random.default_rng((case.seed, STREAM, place, start, rooms or 0, index))
    way = walk(storey, rng, rooms, start)
    if case.order == "near":
        near = nearest_first(storey, start)[0]
        way = Walk(near.rooms[:rooms], near.parents[:rooms])
    return draw_walk(storey, way, "real", rng)


def sides_of(needed: int | None) -> list[tuple[int | None, bool]]:
    """The benchmark's columns on both sides (None: all rooms), and whether the rooms suffice there."""
    if needed is None:
        return [(None, False)]
    below, above = [c for c in COLUMNS if c < needed], [c for c in COLUMNS if c >= needed]
    enough: list[tuple[int | None, bool]] = [(above[0] if above else None, True)]
    return [(below[-1], False), *enough] if below else enough


def tables(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """For each building the shares of start rooms for which the benchmark confirms the prediction."""
    lines = []
    for row in rows.itertuples():
        starts = [Start.model_validate(start) for start in row.starts]
        enough, fewer = ([s.agrees for start in starts for s in start.sides if s.predicted == p] for p in (True, False))
        both = [all(side.agrees for side in start.sides) for start in starts]
        lines.append({
            "building": Path(row.building).stem, "start rooms": len(starts), "enough rooms: known": _percent(enough),
            "fewer rooms, or never: not known": _percent(fewer), "both": _percent(both),
        })  # fmt: skip
    return {"buildings": pd.DataFrame(lines)}


def _percent(hits: Sequence[bool]) -> str:
    return f"{100 * sum(hits) / len(hits):.0f} % ({sum(hits)} of {len(hits)})" if hits else ""


STUDY = Study(
    name="rooms_to_localise",
    asks="whether inspect-bim predicts rightly how many rooms must be seen",
    options=Choice,
    quick=Choice(buildings=("demo",), every=4, pairs=9, maps=5),
    case=BuildingCase,
    record=Starts,
    cases=cases,
    measure=measure,
    tables=tables,
)
