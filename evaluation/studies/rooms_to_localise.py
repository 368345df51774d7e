"""Checks the number of rooms that inspect-bim predicts to be needed, on the matching benchmark's maps.

    python -m evaluation.studies.rooms_to_localise FILE --inspection FILE

Each start room is checked with pairs of the matching benchmark (regime `real`) that start there. The benchmark draws
its own noise and explores rooms in any order or, with `--order near`, the nearest first, as in the prediction. Each
prediction is checked on both sides: in the benchmark's first column with enough rooms, most pairs must be matched
uniquely and correctly; in the column before it, most must not. If a room is predicted to be never localised, most pairs
of all rooms must not be. Where about half of all maps are localised, the result is a matter of chance.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from data import SceneGraph
from data.common.cli import Parser, run_command
from data.common.errors import UserError
from data.synthetic_maps.noise_models import DrawnGraph, draw_walk
from evaluation.matching_benchmark.judge import is_wrong
from evaluation.matching_benchmark.pairs import COLUMNS, truth_of
from matching import Matcher

OUTCOMES = ("known", "never")
ORDERS = ("any", "near")
CLEAR = 6  # pairs; a majority of this size ends the check
STREAM = 900_001  # of random numbers; not the index of a storey, so that inspect-bim never draws the same maps


@dataclass(frozen=True)
class Side:
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


@dataclass(frozen=True)
class Start:
    """A start room and both sides of its check."""

    room: str
    needed: int | None
    sides: tuple[Side, ...]


def main(arguments: list[str] | None = None) -> int:
    """The command. Raises UserError."""
    parser = Parser(
        prog="python -m evaluation.studies.rooms_to_localise", description="Check the predictions of inspect-bim."
    )
    parser.add_argument("bim", type=Path, metavar="FILE", help="the building that was inspected")
    parser.add_argument("--inspection", type=Path, required=True, metavar="FILE", help="inspection.json of inspect-bim")
    parser.add_argument("--pairs", type=int, default=31, metavar="N", help="most pairs on each side (default 31)")
    parser.add_argument("--order", choices=ORDERS, default="any", help="order of exploration (default: any)")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="check every Nth start room (default: all)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="seed of the pairs")
    options = parser.parse_args(arguments)
    if options.pairs < 1 or options.every < 1:
        raise UserError("--pairs and --every: must be 1 or more")
    from data.common.json_files import read_json
    from data.plans import load_bim

    inspection = read_json(options.inspection, "what inspect-bim wrote")
    graph = load_bim(options.bim).graph
    predicted = {r["room"]: (r["outcome"], r["rooms"]) for r in _rooms(inspection, options.inspection)}
    if unknown := sorted(predicted.keys() - graph.room_by_id.keys()):
        raise UserError(f"{options.inspection}: room '{unknown[0]}' is not in {options.bim}; give the same building")
    chosen = {r: v for n, (r, v) in enumerate(predicted.items()) if n % options.every == 0 and v[0] in OUTCOMES}
    print(table(list(checked(graph, chosen, options.pairs, options.seed, options.order)), options.bim.name))
    return 0


def _rooms(inspection: Any, path: Path) -> list[dict[str, Any]]:
    try:
        return [dict(r) for r in inspection["rooms"]]
    except (KeyError, TypeError, ValueError):
        raise UserError(f"{path}: not an inspection; give the inspection.json of inspect-bim") from None


def checked(
    graph: SceneGraph, predicted: dict[str, tuple[str, int | None]], pairs: int, seed: int, order: str = "any"
) -> Iterator[Start]:  # fmt: skip
    """Checks the start rooms in the plan's order; `predicted` by room id: the outcome and the number of rooms."""
    from data.synthetic_maps.exploration import Walk, storeys_of, walk
    from data.synthetic_maps.walks import nearest_first

    matcher = Matcher.load()
    for place, storey in enumerate(storeys_of(graph)):
        for start, room in enumerate(storey.rooms):
            if room.id not in predicted:
                continue
            needed, near = predicted[room.id][1], nearest_first(storey, start)[0]
            sides = []
            for count, should in sides_of(needed):
                known = of = 0
                while of < pairs and abs(2 * known - of) < CLEAR and 2 * max(known, of - known) <= pairs:
                    rng = np.random.default_rng((seed, STREAM, place, start, count or 0, of))
                    of += 1
                    way = walk(storey, rng, count, start)
                    if order == "near":
                        way = Walk(near.rooms[:count], near.parents[:count])
                    known += _known(matcher, draw_walk(storey, way, "real", rng), graph)
                sides.append(Side(count, should, known, of))
            yield Start(room.id, needed, tuple(sides))


def _known(matcher: Matcher, drawn: DrawnGraph, graph: SceneGraph) -> bool:
    if not drawn.s_graph.wall_surfaces:
        return False
    answer = matcher.match(drawn.s_graph, graph)
    return answer.status == "unique" and not is_wrong(answer, truth_of(drawn), False)


def sides_of(needed: int | None) -> list[tuple[int | None, bool]]:
    """The benchmark's columns on both sides (None: all rooms), and whether the rooms suffice there."""
    if needed is None:
        return [(None, False)]
    below, above = [c for c in COLUMNS if c < needed], [c for c in COLUMNS if c >= needed]
    enough: list[tuple[int | None, bool]] = [(above[0] if above else None, True)]
    return [(below[-1], False), *enough] if below else enough


def table(starts: Sequence[Start], building: str) -> str:
    """Markdown table: shares of start rooms for which the benchmark confirms the prediction."""
    if not starts:
        raise UserError("no start room to check; see --inspection")
    lines = [f"| {building}, {len(starts)} start rooms | as predicted |", "|---|---|"]
    kinds = {"enough rooms: known": True, "fewer rooms, or never: not known": False}
    for label, known in kinds.items():
        sides = [side.agrees for start in starts for side in start.sides if side.predicted == known]
        lines.append(f"| {label} ({len(sides)}) | {_percent(sides)} |")
    lines.append(f"| both sides | {_percent([all(side.agrees for side in start.sides) for start in starts])} |")
    return "\n".join(lines)


def _percent(hits: Sequence[bool]) -> str:
    return f"{100 * sum(hits) / len(hits):.0f} % ({sum(hits)} of {len(hits)})" if hits else "-"


if __name__ == "__main__":
    run_command(main)
