"""What becomes of a match: how many of its answers are right, and the time that it took."""

from dataclasses import astuple
from time import perf_counter, process_time

import pandas as pd

from data import SceneGraph
from evaluation.matching.methods import method_named
from evaluation.matching.pairs import KnownMap
from evaluation.metrics.matches import matching_scores, unique_is_wrong
from evaluation.metrics.statistics import Bin, Score, binned, calibration_error
from evaluation.metrics.true_matches import TrueMatches
from evaluation.study import Record
from evaluation.tables import Column, count, mean, rare
from matching import MatchResult

LATE, RAISED = "late", "raised"  # a method took too long, or raised an error: there is no answer
AGAIN_S = 1.0  # a match that takes less is timed twice: a busy machine only adds to a time
NOTHING = MatchResult("none", "")


def answered(known: KnownMap, method: str, limit_s: float) -> Record:
    """The record of a method's answer. Raises UserError for an unknown method."""
    match, s_graph, deformed = method_named(method), known.drawn.s_graph, known.drawn.deformed
    cpu, wall = process_time(), perf_counter()
    try:
        result = match(known)
        late = perf_counter() - wall >= limit_s
        answer, reason = (LATE, f"over {limit_s:g} s") if late else (result.status, result.reason)
        scores = score(NOTHING if late else result, known.truth, s_graph, deformed)
    except Exception as error:
        answer, reason = RAISED, f"{type(error).__name__}: {error}".splitlines()[0]
        scores = score(NOTHING, known.truth, s_graph, deformed)
    seconds = process_time() - cpu
    if answer != RAISED and seconds < AGAIN_S:
        cpu = process_time()
        match(known)
        seconds = min(seconds, process_time() - cpu)
    return {"answer": answer, "reason": reason, "seconds": seconds, "s_rooms": len(s_graph.rooms), **scores}


def score(result: MatchResult, truth: TrueMatches, s_graph: SceneGraph, deformed: bool) -> Record:
    """Whether the answer is `unique` and wrong, the scores of walls, of rooms, and of both together (`node`), and the
    confidences of all walls in bins. Where nothing of the map is in the plan, every unique answer is wrong.

    Raises UserError if the answer violates the contract.
    """
    nowhere = not truth.rooms and not truth.wall_surfaces
    found = matching_scores(result, truth, s_graph)
    both = zip(astuple(found.rooms), astuple(found.wall_surfaces), strict=True)
    bins = binned(
        [confidence for _, _, confidence in result.wall_surfaces],
        [truth.wall_surfaces.get(s) == a for s, a, _ in result.wall_surfaces],
    )
    return {
        "wrong": result.status == "unique" if nowhere else unique_is_wrong(result, truth, deformed),
        "wall": _written(found.wall_surfaces),
        "room": _written(found.rooms),
        "node": _written(Score(*map(sum, both))),
        "bins": [astuple(one) for one in bins],
    }


def _written(of: Score) -> Record:
    return {"precision": of.precision, "recall": of.recall, "f1": of.f1}


def matches_of(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each match, with its CPU seconds: cases of drives have several maps."""
    each = rows.explode("maps", ignore_index=True).dropna(subset="maps").reset_index(drop=True)
    matches = pd.json_normalize(each.maps.tolist())
    return each.drop(columns=["maps", "seconds"]).join(matches)


def wrong(rows: pd.DataFrame) -> str:
    """How many of the unique answers are wrong."""
    sure = rows[rows.answer == "unique"]
    return rare(sure.wrong.astype(bool), sure.building, "")


def placed(rows: pd.DataFrame) -> str:
    """How many maps have a unique answer."""
    return rare(rows.answer == "unique", rows.building, "maps")


def _share(*answers: str) -> Column:
    return lambda rows: f"{100 * rows.answer.isin(answers).mean():.0f}"


def _mean(name: str) -> Column:
    return lambda rows: f"{rows[name].astype(float).mean():.3f}" if rows[name].notna().any() else ""


def _calibration(rows: pd.DataFrame) -> str:
    every = pd.DataFrame([one for bins in rows.bins for one in bins], columns=["index", "count", "right", "sum"])
    sums = every.groupby("index")[["count", "right", "sum"]].sum().reset_index()
    error = calibration_error(tuple(Bin(*one) for one in sums.itertuples(index=False)))
    return "" if error is None else f"{error:.3f}"


FOUND: dict[str, Column] = {
    "maps": count(),
    "wall F1": mean("wall.f1"),
    "unique (%)": _share("unique"),
    "wrong of unique": wrong,
    "median (s)": lambda rows: f"{rows.seconds.median():.3f}",
}
MEASURES: dict[str, Column] = {
    **{f"{kind} {of}": _mean(f"{kind}.{of}") for kind in ("wall", "room") for of in ("precision", "recall")},
    "wall ECE": _calibration,
    "late or raised": count(lambda rows: rows.answer.isin((LATE, RAISED))),
}
NODES: dict[str, Column] = {
    "maps": count(),
    **{of.capitalize(): _mean(f"node.{of}") for of in ("precision", "recall", "f1")},
    "mean (s)": lambda rows: f"{rows.seconds.mean():.3f}",
    "completed (%)": _share("unique", "ambiguous", "none"),
}
