"""False anchors: each drive is run with the plans of the other buildings.

    python -m evaluation.studies.negative_plans --out DIR --list FILE

No map may be anchored to another building's plan, not even for a single scan.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from data.common.cli import Parser, run_command
from data.common.errors import UserError
from data.common.files import write_atomically
from data.scans import ScanFolder
from data.scene_graph import SceneGraph
from evaluation.harness import Sequence, SequenceSpec, prepare, read_specs, select_sequences
from evaluation.drives.sequences import plan_of
from matching import Matcher, MatchResult
from sgslam.slam import SceneGraphSlam

HEAD = ("scans of", "seed", "plan of", "scans", "rooms seen", "rooms planned", "answers", "anchored", "reason")
STATUSES = ("unique", "ambiguous", "none")


@dataclass(frozen=True)
class Pairing:
    """One drive with another building's plan; `anchored_scans` counts the scans after which it was anchored."""

    sequence: str
    seed: int
    plan: str
    scans: int
    rooms_seen: int
    rooms_planned: int
    answers: dict[str, int]  # number of answers by status
    anchored_scans: int
    reason: str

    def cells(self) -> tuple[str, ...]:
        """The table's cells, in the order of HEAD."""
        answers = ", ".join(f"{self.answers[s]} {s}" for s in STATUSES if self.answers.get(s)) or "not matched"
        anchored = f"**for {self.anchored_scans} scans**" if self.anchored_scans else "never"
        return (
            self.sequence, str(self.seed), self.plan, str(self.scans), str(self.rooms_seen), str(self.rooms_planned),
            answers, anchored, self.reason,
        )  # fmt: skip


class _Counting:
    """A matcher that counts its answers by status."""

    def __init__(self, method: str) -> None:
        self._matcher, self.answers = Matcher.load(method), Counter[str]()

    def match(self, s: SceneGraph, a: SceneGraph) -> MatchResult:
        """Matches like any matcher."""
        answer = self._matcher.match(s, a)
        self.answers[answer.status] += 1
        return answer


def run_with(sequence: Sequence, plan: str, a_graph: SceneGraph, method: str = "learned") -> Pairing:
    """Runs the scans of `sequence` with another building's A-graph, named `plan`."""
    matcher = _Counting(method)
    slam = SceneGraphSlam(a_graph, matcher)
    anchored = sum(slam.add_scan(scan.stamp_ns, scan.points).anchored for scan in ScanFolder(sequence.scan_dir))
    result = slam.finish()
    return Pairing(
        sequence.name, sequence.seed, plan, len(result.trajectory), len(result.s_graph.rooms), len(a_graph.rooms),
        dict(matcher.answers), anchored + result.anchored, result.reason,
    )  # fmt: skip


def pairings(specs: list[SequenceSpec], seeds: list[int], folder: Path, method: str = "learned") -> Iterator[Pairing]:
    """Runs every drive with the plan of every other building; drives missing in `folder` are simulated.

    Raises UserError if there is only one building.
    """
    if len({spec.bim for spec in specs}) < 2:
        raise UserError("--sequences: only one building; name sequences of at least two")
    for spec in specs:
        others = {other.bim: other for other in reversed(specs) if other.bim != spec.bim}
        for seed in seeds if spec.simulated else seeds[:1]:
            sequence = prepare(spec, seed, folder)
            for other in reversed(others.values()):
                yield run_with(sequence, other.name, plan_of(other, folder), method)


def table(found: list[Pairing]) -> str:
    """Markdown table: a line for each pairing, and the total."""
    rows = [HEAD, ("---",) * len(HEAD), *(pairing.cells() for pairing in found)]
    wrong = sum(pairing.anchored_scans > 0 for pairing in found)
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([*lines, "", f"Anchored at any time: {wrong} of {len(found)} pairings."]) + "\n"


def main() -> int:
    """The command line."""
    parser = Parser(
        prog="python -m evaluation.studies.negative_plans", description="Run drives with other buildings' plans."
    )
    add = parser.add_argument
    add("--out", type=Path, required=True, metavar="DIR", help="folder for negative_plans.md and drives")
    add("--list", type=Path, required=True, metavar="FILE", help="YAML list of sequences")
    add("--sequences", nargs="+", metavar="NAME", help="only these of the list")
    add("--seeds", nargs="+", type=int, default=[0], metavar="N", help="seeds of the drives (default 0)")
    add("--method", default="learned", metavar="NAME", help="matching method (default learned)")
    add("--benchmarks", type=Path, metavar="FILE", help="page of results; its section 'negative-plans' is written")
    options = parser.parse_args()
    specs = select_sequences(read_specs(options.list), options.sequences)
    options.out.mkdir(parents=True, exist_ok=True)
    found: list[Pairing] = []
    for pairing in pairings(specs, options.seeds, options.out, options.method):
        print("  ".join(pairing.cells()), flush=True)
        found.append(pairing)
    text = table(found)
    write_atomically(options.out / "negative_plans.md", f"# Plans of other buildings\n\n{text}")
    if options.benchmarks is not None:
        from evaluation.harness.benchmark_page import made_by, write_section

        names = f" --sequences {' '.join(options.sequences)}" if options.sequences else ""
        command = f"python -m evaluation.studies.negative_plans --out {options.out.name} --list {options.list}{names}"
        section = f"{ABOUT}\n\n{text}\nBy {made_by(command)}."
        write_section(options.benchmarks, "negative-plans", f"## Plans of other buildings\n\n{section}")
    return 0


ABOUT = (
    "Each drive with the plan of every other building of the list. Whether the map is anchored is checked after every "
    "scan, not only at the end."
)

if __name__ == "__main__":
    run_command(main)
