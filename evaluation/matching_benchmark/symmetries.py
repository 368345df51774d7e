"""Results on maps with an alternative placement in the plan, against what an ideal observer could decide."""

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtr

from evaluation.matching_benchmark.rows import ORACLE, Row
from matching.ambiguity.symmetries import EQUAL, SURE

HEADER = ("method", "alternatives", "pairs", "unique", "wrong", "ideal observer", "ambiguous", "none")
NOTE = (
    "Equal: the expected evidence for the truth over the nearest alternative placement is less than a nat; alike: up "
    f"to {SURE:.1f} nats (odds of 199 to 1). Ideal observer: the expected number of pairs that an observer who knows "
    "the noise model can decide at these odds. Small and large plans and all regimes together"
)


def lines(rows: Sequence[Row]) -> list[tuple[str, ...]]:
    """The lines of the table: for each method but the oracle, pairs with equal and with alike alternatives."""
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
    """The expected number of pairs whose evidence reaches `SURE`: between two Gaussian hypotheses with an expected
    evidence of a nats it is normal with mean a and variance 2 a. Negative expected evidence counts as zero."""
    nats = np.array([max(r.rival, 1e-9) for r in rows if r.rival is not None])
    return float(ndtr((nats - SURE) / np.sqrt(2 * nats)).sum())
