"""Maps of which another place of the plan is a twin: what is answered, and how much could be known."""

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtr

from evaluation.matching_benchmark.rows import ORACLE, Row
from matching.ambiguity.symmetries import EQUAL, SURE

HEADER = ("method", "twins", "pairs", "unique", "wrong", "one who knows the noise", "ambiguous", "none")
NOTE = (
    "Equal: the evidence to be expected for the truth over the nearest other place is less than a nat; alike: up to "
    f"{SURE:.1f} nats (odds of 199 to 1), of which what is seen may tell them apart. `one who knows the noise`: how "
    "many of the pairs an observer must expect to tell apart, by such odds, who knows the noise that maps are drawn "
    "with. Small and large plans and all regimes together"
)


def lines(rows: Sequence[Row]) -> list[tuple[str, ...]]:
    """The lines of the table, for each method but the oracle those of equal twins and those of alike ones."""
    found = list[tuple[str, ...]]()
    for method in dict.fromkeys(r.method for r in rows if r.method != ORACLE):
        twins = [r for r in rows if r.method == method and r.rival is not None]
        for name, own in (("equal", [r for r in twins if _equal(r)]), ("alike", [r for r in twins if not _equal(r)])):
            if own:
                status = [r.status for r in own]
                unique, ambiguous, none = (str(status.count(s)) for s in ("unique", "ambiguous", "none"))
                known, wrong = f"{to_be_sure(own):.1f}", str(sum(r.wrong for r in own))
                found.append((method, name, str(len(own)), unique, wrong, known, ambiguous, none))
    return found


def _equal(row: Row) -> bool:
    return row.rival is not None and row.rival < EQUAL


def to_be_sure(rows: Sequence[Row]) -> float:
    """In how many of the pairs the evidence comes to `SURE`: between two Gaussian hypotheses for which a nats are to be
    expected it is normal about a, with the variance 2 a. What is below nothing, for the twin, counts as nothing."""
    nats = np.array([max(r.rival, 1e-9) for r in rows if r.rival is not None])
    return float(ndtr((nats - SURE) / np.sqrt(2 * nats)).sum())
