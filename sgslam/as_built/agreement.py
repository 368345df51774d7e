"""Deviations that the verdict on the whole element contradicts are not significant."""

from collections.abc import Sequence

from sgslam.as_built.deviation_entries import Deviation, MovedDeviation
from sgslam.as_built.elements import ElementVerdict

_AS_PLANNED = "by all that was seen of it, this wall stands as planned; this is something in front of it or behind it"


def agreed(deviations: Sequence[Deviation], verdicts: Sequence[ElementVerdict]) -> list[Deviation]:
    """The deviations, those of walls that stand as planned by all their sightings without significance.

    A deviation is of one mapped surface; the verdict on an element weighs all that was seen at its place.
    """
    standing = {verdict.global_id for verdict in verdicts if verdict.verdict == "as planned"}
    return [_insignificant(own) if own["kind"] == "moved" and own["source"] in standing else own for own in deviations]


def _insignificant(own: MovedDeviation) -> Deviation:
    return {**own, "significant": False, "reason": _AS_PLANNED} if own["significant"] else own
