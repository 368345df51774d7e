"""`python -m evaluation.published.se2_subsets FILE`: matches every part of a known map, randomly moved, with its plan.

FILE is JSON with `s_graph`, `a_graph` and `matches` ({"rooms", "wall_surfaces"}: [[S id, A id], ...]).
"""

import itertools
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from data import SceneGraph
from data.common.cli import Parser, run_command
from data.common.errors import UserError
from data.geometry import se2
from data.scene_graph.motion import moved
from evaluation.matching_benchmark.judge import is_wrong, tallies
from evaluation.matching_benchmark.rows import Tally
from evaluation.metrics.bootstrap import upper_bound
from evaluation.metrics.calibration import calibration_error, merged
from evaluation.metrics.statistics import Score
from evaluation.metrics.surface_overlap import best_rigid_fit
from evaluation.metrics.true_matches import TrueMatches

FEWEST = 2  # rooms
REACH = 20.0  # metres


@dataclass(frozen=True)
class Known:
    """A map, its plan, and the true matches of rooms and wall surfaces."""

    s_graph: SceneGraph
    a_graph: SceneGraph
    rooms: dict[str, str]
    wall_surfaces: dict[str, str]

    @staticmethod
    def load(path: Path) -> "Known":
        """Reads a file. Raises UserError if it does not have this form."""
        try:
            value = json.loads(path.read_text())
            s_graph, a_graph = (SceneGraph.from_dict(value[of]) for of in ("s_graph", "a_graph"))
            return Known(s_graph, a_graph, *(dict(value["matches"][of]) for of in ("rooms", "wall_surfaces")))
        except (UserError, ValueError, KeyError, TypeError):
            raise UserError(f"{path}: needs s_graph, a_graph and matches, as JSON") from None


@dataclass(frozen=True)
class Outcome:
    """The outcome of one part under one motion."""

    rooms_seen: int
    status: str
    wrong: bool
    seconds: float
    rooms: Tally
    walls: Tally


def parts(known: Known) -> list[SceneGraph]:
    """The map's parts with at least 2 rooms, with the walls that face them."""
    every = (
        c for k in range(FEWEST, len(known.s_graph.rooms) + 1) for c in itertools.combinations(known.s_graph.rooms, k)
    )
    found = []
    for rooms in every:
        ids = {r.id for r in rooms}
        walls = tuple(w for w in known.s_graph.wall_surfaces if w.room in ids)
        found.append(SceneGraph("map", tuple(rooms), walls))
    return found


def outcomes(known: Known, matcher: Any, motions: int, seed: int = 0) -> Iterator[Outcome]:
    """Matches every part under `motions` random motions."""
    rng = np.random.default_rng(seed)
    for part in parts(known):
        pairs = {w.id: known.wall_surfaces[w.id] for w in part.wall_surfaces if w.id in known.wall_surfaces}
        T_a_part = best_rigid_fit(part, known.a_graph, pairs)
        for _ in range(motions):
            T_s_part = np.array([rng.uniform(-np.pi, np.pi), *rng.uniform(-REACH, REACH, 2)])
            s = moved(part, T_s_part)
            yaw, x, y = se2.compose(T_a_part, se2.inverse(T_s_part)).tolist()
            rooms = {r.id: known.rooms[r.id] for r in s.rooms if r.id in known.rooms}
            floor = known.a_graph.room_by_id[next(iter(rooms.values()))].floor if rooms else None
            cx, cy = s.centroid().tolist()
            truth = TrueMatches(rooms, pairs, (yaw, x, y), floor, (cx, cy))
            result = matcher.match(s, known.a_graph)
            wrong = is_wrong(result, truth, bent=False)
            yield Outcome(len(s.rooms), result.status, wrong, result.seconds, *tallies(result, truth, s))


def table(found: list[Outcome]) -> str:
    """Markdown table: a line for each number of rooms, and one for all; F1 is over all nodes."""
    head = (
        "rooms",
        "matches",
        "room F1",
        "wall F1",
        "all right",
        "unique",
        "wrong",
        "ECE walls",
        "ECE rooms",
        "median s",
    )
    lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    for rooms in (*sorted({o.rooms_seen for o in found}), None):
        own = [o for o in found if rooms is None or o.rooms_seen == rooms]
        unique = sum(o.status == "unique" for o in own)
        wrong = sum(o.wrong for o in own)
        perfect = sum(all(t.right == t.answered == t.true for t in (o.rooms, o.walls)) for o in own)
        errors = [
            calibration_error(merged(t.bins for t in of)) or 0.0
            for of in ([o.walls for o in own], [o.rooms for o in own])
        ]
        bound = f" (≤ {100 * upper_bound(wrong, unique):.1f} %)" if unique else ""
        cells = (
            "all" if rooms is None else str(rooms), str(len(own)), f"{_f1([o.rooms for o in own]):.3f}",
            f"{_f1([o.walls for o in own]):.3f}", f"{100 * perfect / len(own):.1f} %",
            f"{100 * unique / len(own):.1f} %", f"{wrong} of {unique}{bound}", *(f"{e:.3f}" for e in errors),
            f"{np.median([o.seconds for o in own]):.3f}",
        )  # fmt: skip
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _f1(tallies_: list[Tally]) -> float:
    right, answered, true = (sum(getattr(t, of) for t in tallies_) for of in ("right", "answered", "true"))
    return Score(right, answered, right, true).f1 or 0.0


def main() -> int:
    """The command line."""
    parser = Parser(
        prog="python -m evaluation.published.se2_subsets", description="Match all parts of a known map."
    )
    parser.add_argument("file", type=Path, metavar="FILE", help="JSON with s_graph, a_graph and matches")
    parser.add_argument("--method", default="learned", metavar="NAME")
    parser.add_argument("--motions", type=int, default=20, metavar="N", help="motions of each part (default 20)")
    parser.add_argument("--page", type=Path, metavar="FILE", help="page of results; its section 'se2' is written")
    options = parser.parse_args()
    from evaluation.harness.benchmark_page import made_by, write_section
    from matching import Matcher

    text = table(list(outcomes(Known.load(options.file), Matcher.load(options.method), options.motions)))
    if options.page is not None:
        arguments = f"{options.file} --method {options.method} --motions {options.motions}"
        command = f"python -m evaluation.published.se2_subsets {arguments}"
        write_section(options.page, "se2", f"{HEAD}\n\n{text}\n{made_by(command)}")
    print(text, end="")
    return 0


HEAD = (
    "### A map that a published system built\n\n"
    "All parts with at least 2 rooms of one S-graph built by the published LiDAR SLAM, each moved by random motions. "
    "F1 is over all nodes."
)


if __name__ == "__main__":
    run_command(main)
