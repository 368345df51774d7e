"""The figure of the published matcher with an unknown start."""

from collections.abc import Sequence
from pathlib import Path

from evaluation.matching_benchmark.rows import Row
from evaluation.published.page import f1_of
from evaluation.published.pairs import STARTS, start_regime

METHODS = {"paper@published": "C3", "paper@repository": "C1", "voting": "C0", "learned": "C2"}


def write_collapse(rows: Sequence[Row], path: Path) -> None:
    """Plots F1 against the uncertainty of the start and, in the regime `real`, against the rooms seen, as SVG."""
    import matplotlib  # slow to import

    matplotlib.use("Agg")
    matplotlib.rcParams["svg.hashsalt"] = "sgslam"  # the same rows make the same file
    from matplotlib import pyplot as plt

    sets = {r.plans for r in rows if r.regime == start_regime(STARTS[-1])}
    figure, (left, right) = plt.subplots(1, 2, figsize=(7.4, 3.0), sharey=True)
    starts = [start_regime(m) for m in (0.0, *STARTS)]
    seen = sorted({r.rooms for r in rows if r.regime == "real"}, key=lambda n: n or 10**6)
    for method, colour in METHODS.items():
        own = [r for r in rows if r.method == method]
        of_start = [[r for r in own if r.regime == s and r.plans in sets] for s in starts]
        of_rooms = [[r for r in own if r.regime == "real" and r.rooms == n] for n in seen]
        for ax, cells in ((left, of_start), (right, of_rooms)):
            at = [k for k, cell in enumerate(cells) if cell]
            ax.plot(at, [f1_of(cells[k]) for k in at], color=colour, marker="o", ms=3, label=f"{method}")
    left.set(title="published perturbation", xlabel="start known to within", ylabel="F1", ylim=(0, 1.03))
    left.set_xticks(range(len(starts)), ["exactly", *(f"±{m:g} m" for m in STARTS)])
    right.set(title="maps as of real scans", xlabel="rooms seen")
    right.set_xticks(range(len(seen)), [str(n or "all") for n in seen])
    for ax in (left, right):
        ax.grid(alpha=0.3)
    left.legend(fontsize=7, loc="lower left")
    figure.savefig(path, metadata={"Date": None}, bbox_inches="tight")
    plt.close(figure)
