"""False anchors: each drive is run with the plans of the other buildings.

No map may be anchored to another building's plan, not even for a single scan.
"""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from data.common.errors import UserError
from data.scans import ScanFolder
from data.scene_graph import SceneGraph
from evaluation.drives.sequences import DriveCase, DriveOptions, SequenceSpec, plan_of, prepare
from evaluation.harness import Claim, Record, Study
from evaluation.harness.tables import rare
from matching import Matcher, MatchResult
from sgslam.slam import SceneGraphSlam

STATUSES = ("unique", "ambiguous", "none")


class Choice(DriveOptions):
    """Which drives, all of the list by default, and the matching method."""

    sequences: tuple[str, ...] = ()
    seeds: tuple[int, ...] = (0,)
    method: str = "learned"


class Pairing(DriveCase):
    """A drive with the plan of another building."""

    plan: SequenceSpec
    method: str

    def files(self) -> set[str]:
        """Those of the sequence, and the other plan."""
        return self.sequence.files() | ({self.plan.bim} - {"demo"})


class Answers(Record):
    """The matcher's answers by status, and the number of scans after which the run was anchored."""

    scans: int
    rooms_seen: int
    rooms_planned: int
    unique: int
    ambiguous: int
    none: int
    anchored_scans: int
    reason: str


class _Counting:
    """A matcher that counts its answers by status."""

    def __init__(self, method: str) -> None:
        self._matcher, self.answers = Matcher.load(method), Counter[str]()

    def match(self, s: SceneGraph, a: SceneGraph) -> MatchResult:
        """Matches like any matcher."""
        answer = self._matcher.match(s, a)
        self.answers[answer.status] += 1
        return answer


def cases(options: Choice) -> list[Pairing]:
    """Every drive with the plan of every other building. Raises UserError if there is only one building."""
    drives = list(options.drives())
    plans = {spec.bim: spec for spec, _ in reversed(drives)}
    if len(plans) < 2:
        raise UserError("sequences: only one building; name sequences of at least two")
    return [
        Pairing(sequence=spec, seed=seed, plan=plan, method=options.method)
        for spec, seed in drives for plan in reversed(plans.values()) if plan.bim != spec.bim
    ]  # fmt: skip


def measure(case: Pairing, work: Path) -> Answers:
    """Runs the drive with the plan."""
    sequence, a_graph = prepare(case.sequence, case.seed, work), plan_of(case.plan, work)
    matcher = _Counting(case.method)
    slam = SceneGraphSlam(a_graph, matcher)
    anchored = sum(slam.add_scan(scan.stamp_ns, scan.points).anchored for scan in ScanFolder(sequence.scan_dir))
    result = slam.finish()
    return Answers(
        scans=len(result.trajectory), rooms_seen=len(result.s_graph.rooms), rooms_planned=len(a_graph.rooms),
        **{status: matcher.answers[status] for status in STATUSES}, anchored_scans=anchored + result.anchored,
        reason=result.reason,
    )  # fmt: skip


def tables(rows: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """A line for each pairing."""
    cells = pd.DataFrame({
        "scans of": rows["sequence.name"], "seed": rows.seed, "plan of": rows["plan.name"], "scans": rows.scans,
        "rooms seen": rows.rooms_seen, "rooms planned": rows.rooms_planned, "answers": rows.apply(_answers, axis=1),
        "anchored": [f"**for {scans} scans**" if scans else "never" for scans in rows.anchored_scans],
        "reason": rows.reason,
    })  # fmt: skip
    return {"pairings": cells}


def _answers(row: "pd.Series") -> str:  # type: ignore[type-arg]
    return ", ".join(f"{row[status]} {status}" for status in STATUSES if row[status]) or "not matched"


def claims(rows: pd.DataFrame) -> list[Claim]:
    """How often a drive was anchored to another building's plan."""
    wrong = rare((rows.anchored_scans > 0).sum(), len(rows))
    return [Claim("Drives that were ever anchored to another building's plan", wrong, f"{len(rows)} pairings")]


STUDY = Study(
    "negative_plans", "whether a drive is ever anchored to another building's plan",
    Choice, Choice(sequences=("demo", "house-1")), Pairing, Answers, cases, measure, tables, claims,
)  # fmt: skip
