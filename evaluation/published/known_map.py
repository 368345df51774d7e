"""All parts of a map that a published system built, each moved at random, matched with the building's plan."""

import itertools
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd
from pydantic import PositiveFloat, PositiveInt

from data import SceneGraph
from data.common.errors import UserError
from data.plans import Plan
from data.synthetic_maps.noise_models import DrawnGraph, Motion
from evaluation.harness import Claim, Options, Study
from evaluation.harness.tables import grouped, rare
from evaluation.matching_benchmark.judge import judged
from evaluation.matching_benchmark.pairs import Pair, Prepared, prepared
from evaluation.matching_benchmark.records import MatchCase, MatchRecord
from evaluation.matching_benchmark.scores import bins_of, micro_f1, scores_of
from evaluation.metrics.calibration import calibration_error
from evaluation.metrics.surface_overlap import best_rigid_fit
from evaluation.published.pairs import with_motion

SE2 = "../shared/data/slam_graphs/SE2.json"
FEWEST = 2  # rooms
REACH = 20.0  # metres, largest shift of a part along each axis


@dataclass(frozen=True)
class Known:
    """A map, its plan, and the true matches of rooms and wall surfaces."""

    s_graph: SceneGraph
    a_graph: SceneGraph
    rooms: dict[str, str]
    wall_surfaces: dict[str, str]

    @staticmethod
    @lru_cache(maxsize=1)
    def load(path: str) -> "Known":
        """Reads a file: `s_graph`, `a_graph` and `matches` ({"rooms", "wall_surfaces"}: [[S id, A id], ...]).

        Raises UserError if it does not have this form.
        """
        try:
            value = json.loads(Path(path).read_text())
            s_graph, a_graph = (SceneGraph.from_dict(value[of]) for of in ("s_graph", "a_graph"))
            return Known(s_graph, a_graph, *(dict(value["matches"][of]) for of in ("rooms", "wall_surfaces")))
        except (UserError, OSError, ValueError, KeyError, TypeError):
            raise UserError(f"{path}: needs s_graph, a_graph and matches, as JSON") from None

    def parts(self) -> list[SceneGraph]:
        """The map's parts with at least 2 rooms, with the walls that face them."""
        rooms, walls = self.s_graph.rooms, self.s_graph.wall_surfaces
        found = [own for count in range(FEWEST, len(rooms) + 1) for own in itertools.combinations(rooms, count)]
        return [SceneGraph("map", own, tuple(w for w in walls if w.room in {r.id for r in own})) for own in found]

    def drawn(self, part: SceneGraph) -> DrawnGraph:
        """A part with its truth; it lies where its true walls fit best."""
        walls = {w.id: self.wall_surfaces[w.id] for w in part.wall_surfaces if w.id in self.wall_surfaces}
        rooms = {r.id: self.rooms[r.id] for r in part.rooms if r.id in self.rooms}
        yaw, x, y = best_rigid_fit(part, self.a_graph, walls).tolist()
        floor = self.a_graph.room_by_id[next(iter(rooms.values()))].floor if rooms else None
        return DrawnGraph(part, rooms, walls, (yaw, x, y), dict.fromkeys(rooms, (yaw, x, y)), floor, False)


class KnownPart(Pair):
    """Part number `index` of the known map in the file `plans`, moved by T_new_s, (yaw, x, y) in rad and m."""

    regime: Literal["known_map", "known_map_moved"]
    T_new_s: Motion

    def prepare(self) -> Prepared:
        """The part with its truth."""
        return with_motion(_prepared(self.plans, self.index), np.array(self.T_new_s))


@cache
def _prepared(file: str, index: int) -> Prepared:
    known, name = Known.load(file), Path(file).stem
    return Prepared.of(known.drawn(known.parts()[index]), Plan(name, name, known.a_graph))


def known_parts(file: str) -> list[KnownPart]:
    """All parts in the map's own frame; a single one, which the harness skips, where the file is missing."""
    counts: list[int | None] = [None]
    if Path(file).exists():
        known = Known.load(file)
        counts = [len(part.rooms) if len(part.rooms) < len(known.s_graph.rooms) else None for part in known.parts()]
    return [
        KnownPart(
            plans=file, plan=Path(file).stem, regime="known_map", rooms=rooms, index=index, seed=0, T_new_s=(0, 0, 0)
        )
        for index, rooms in enumerate(counts)
    ]  # fmt: skip


class Choice(Options):
    """The known map (JSON, see `Known.load`), the methods, and the number of random motions of each part."""

    file: str = SE2
    methods: tuple[str, ...] = ("learned",)
    motions: PositiveInt = 20
    seed: int = 0
    limit_s: PositiveFloat = 60.0


class PartCase(MatchCase):
    """A part under one motion, and a method."""

    pair: KnownPart


def cases(options: Choice) -> list[PartCase]:
    """All parts under all motions."""
    return [
        PartCase(pair=part, method=method, limit_s=options.limit_s)
        for part in _moved_parts(options) for method in options.methods
    ]  # fmt: skip


def _moved_parts(options: Choice) -> Iterator[KnownPart]:
    rng = np.random.default_rng(options.seed)
    for part in known_parts(options.file):
        for _ in range(options.motions):
            T = (rng.uniform(-np.pi, np.pi), *rng.uniform(-REACH, REACH, 2).tolist())
            yield part.model_copy(update={"regime": "known_map_moved", "T_new_s": T})


def measure(case: MatchCase, work: Path) -> MatchRecord:
    """Matches the part."""
    return judged(prepared(case.pair), case.method, case.limit_s)


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """A line for each number of rooms and one for all, for each method; F1 is over all nodes."""
    own = _scored(rows)
    by = ("method", "rooms")
    parts = (
        part
        for _, of in own.groupby("method", sort=False)
        for part in (of.assign(rooms=of.s_rooms), of.assign(rooms="all"))
    )
    return {"parts": pd.concat([grouped(part, by, _cells) for part in parts])}


def claims(rows: pd.DataFrame) -> list[Claim]:
    """How many parts the learned matcher misses."""
    own = _scored(rows[rows.method == "learned"])
    missed = (~own.unique | own.wrong).sum()
    text = "Parts of a published system's map, moved at random, that the learned matcher does not find, or wrongly"
    return [Claim(text, rare(missed, len(own)), f"{len(own)} parts")]


def _scored(rows: pd.DataFrame) -> pd.DataFrame:
    own = rows.assign(unique=rows.status == "unique", **scores_of(rows, "wall"), **scores_of(rows, "room"))
    return own.assign(perfect=own.wall_perfect & own.room_perfect)


def _cells(own: pd.DataFrame) -> dict[str, str]:
    return {
        "matches": str(len(own)), "room F1": f"{micro_f1(own, 'room') or 0:.3f}",
        "wall F1": f"{micro_f1(own, 'wall') or 0:.3f}", "all right": f"{100 * own.perfect.mean():.1f} %",
        "unique": f"{100 * own.unique.mean():.1f} %", "wrong": rare(own.wrong.sum(), own.unique.sum()),
        "ECE walls": f"{calibration_error(bins_of(own, 'wall')) or 0:.3f}",
        "ECE rooms": f"{calibration_error(bins_of(own, 'room')) or 0:.3f}",
        "median (s)": f"{own.seconds.median():.3f}",
    }  # fmt: skip


STUDY = Study(
    "known_map", "whether all parts of a map that a published system built are found in the building's plan",
    Choice, Choice(motions=1), PartCase, MatchRecord, cases, measure, tables, claims, small=True,
)  # fmt: skip
