"""Time of a match on one core, against the published model's forward pass.

    python -m evaluation.matching_benchmark.timing

Both run alternately in one process, on generated plans and drifting maps of the published sizes. The time is the
minimum CPU time of several runs, since a busy machine only adds to it. For a large plan also the peak memory of a
process of its own.
"""

import multiprocessing
import os
import resource
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from data.common.cli import Parser, run_command
from data.common.errors import UserError
from data.generation.buildings import generate_plan
from data.scene_graph import SceneGraph
from data.synthetic_maps.noise_models import draw
from evaluation.harness.benchmark_page import made_by, write_section
from evaluation.matching_benchmark.tables import Table, markdown
from evaluation.matching_benchmark.worker import THREADS
from matching import Matcher

T = TypeVar("T")
COMMAND, SECTION = "python -m evaluation.matching_benchmark.timing", "matching-time"
HEADER = ("nodes of plan and map", "wall surfaces", "published forward (ms)", "published, whole (ms)", "match (ms)",
          "times the forward", "of it proposals (ms)", "plan's part, once (ms)", "answer")  # fmt: skip
NOTE = (
    "Milliseconds of one core, the least of {repeat} runs in turns, each after one that is not counted. "
    "`published forward` is the reproduction's pass "
    "from tensors to the soft assignment, `published, whole` its graphs and its assignment as well; `match` is all of "
    "`learned`: features, network, search, verification. The plan's part is worked out when a plan is first met; it is "
    "kept. Compiled loops are loaded before: the first match of a process takes 0.2 s longer, the first of an "
    "installation, which compiles them, about a minute."
)
LARGE_HEADER = ("wall surfaces of plan and map", "match (s)", "first match, the plan's part as well (s)",
                "memory at most (MB)", "of it for the matching (MB)", "answer")  # fmt: skip
LARGE_NOTE = "One core, a process of its own; its memory begins with Python, PyTorch and the plan."


@dataclass(frozen=True)
class Case:
    """A generated plan, reduced to `surfaces` wall surfaces (None: all), and a map of `rooms` rooms."""

    kind: str
    seed: int
    surfaces: int | None
    rooms: int
    regime: str = "drift"

    def graphs(self) -> tuple[SceneGraph, SceneGraph]:
        """The S-graph and the A-graph."""
        from matching.training.data import part  # imports torch

        plan = generate_plan(self.kind, self.seed).graph
        a = plan if self.surfaces is None else part(plan, self.surfaces, np.random.default_rng(self.seed))
        return draw(a, self.regime, np.random.default_rng(self.seed), self.rooms).s_graph, a


CASES = (Case("office", 500_009, 72, 13), Case("corridor", 500_006, 319, 51))  # 95 and 69 nodes, 389 and 290
LARGE = Case("campus", 9833, None, 44)  # 4,982 and about 200 wall surfaces


@dataclass(frozen=True)
class Times:
    """CPU seconds; sizes are (plan, map)."""

    nodes: tuple[int, int]
    surfaces: tuple[int, int]
    forward: float
    published: float
    match: float
    proposals: float
    first: float
    answer: str


@dataclass(frozen=True)
class Large:
    """CPU seconds and megabytes."""

    surfaces: tuple[int, int]
    match: float
    first: float
    memory: float
    grown: float
    answer: str


def measured(case: Case, repeat: int) -> Times:
    """Measures everything alternately."""
    from matching.learned import LearnedProposer
    from matching.published.forward import paper_forward  # imports torch

    s, a = case.graphs()
    Matcher.load("learned").match(s, a)  # loads, or compiles, what is compiled
    learned, published = Matcher.load("learned"), Matcher.load("paper")
    first = _seconds(lambda: learned.match(s, a))
    proposer = LearnedProposer.load()
    turns: list[Callable[[], object]] = [
        paper_forward(s, a), lambda: published.match(s, a), lambda: learned.match(s, a), lambda: proposer.propose(s, a)
    ]  # fmt: skip
    least = [float("inf")] * len(turns)
    for _ in range(repeat + 1):
        for k, run in enumerate(turns):
            run()  # warms the CPU caches, which hold another method's data
            least[k] = min(least[k], _seconds(run))
    forward, whole, match, proposals = least
    answer = learned.match(s, a).status
    return Times(*_sizes(s, a), forward, whole, match, proposals, max(first - match, 0.0), answer)


def measure_large(case: Case, repeat: int) -> Large:
    """Measures a large case; call it in a new process, since it reports the process's memory."""
    s, a = case.graphs()
    learned, small = Matcher.load("learned"), CASES[0].graphs()
    learned.match(*small)  # what is loaded when it is first needed
    before = _peak_memory()
    first = _seconds(lambda: learned.match(s, a))
    match = min(_seconds(lambda: learned.match(s, a)) for _ in range(repeat))
    memory = _peak_memory()
    return Large(_sizes(s, a)[1], match, first, memory, memory - before, learned.match(s, a).status)


def _sizes(s: SceneGraph, a: SceneGraph) -> tuple[tuple[int, int], tuple[int, int]]:
    surfaces = len(a.wall_surfaces), len(s.wall_surfaces)
    return (len(a.rooms) + surfaces[0], len(s.rooms) + surfaces[1]), surfaces


def _seconds(run: Callable[[], object]) -> float:
    began = time.process_time()
    run()
    return time.process_time() - began


def _peak_memory() -> float:
    """The peak memory (MB) of this process."""
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most / (1e6 if sys.platform == "darwin" else 1e3)


def in_new_process(work: Callable[..., T], *arguments: object) -> T:
    """The result of a function called in a new process with one thread."""
    os.environ.update(dict.fromkeys(THREADS, "1"))
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(work, *arguments).result()


def page_of(times: Sequence[Times], large: Large, repeat: int) -> str:
    """The section in Markdown."""
    lines = tuple(
        (" and ".join(map(str, t.nodes)), " and ".join(map(str, t.surfaces)), *_ms(t.forward, t.published, t.match),
         f"{t.match / t.forward:.1f}", *_ms(t.proposals, t.first), t.answer) for t in times
    )  # fmt: skip
    line = (" and ".join(map(str, large.surfaces)), f"{large.match:.2f}", f"{large.first:.2f}",
            f"{large.memory:.0f}", f"{large.grown:.0f}", large.answer)  # fmt: skip
    return "\n".join((
        markdown(Table("Time of a match", NOTE.format(repeat=repeat), HEADER, lines)),
        markdown(Table("A large plan", LARGE_NOTE, LARGE_HEADER, (line,))), made_by(COMMAND),
    ))  # fmt: skip


def _ms(*seconds: float) -> tuple[str, ...]:
    return tuple(f"{1e3 * s:.1f}" for s in seconds)


def main() -> int:
    """The command line."""
    parser = Parser(prog=COMMAND, description="Time a match on one core against the published forward pass.")
    parser.add_argument("--repeat", type=int, default=20, metavar="N", help="repetitions (default 20)")
    parser.add_argument("--page", type=Path, metavar="FILE", help="page of results; its section is written")
    options = parser.parse_args()
    if options.repeat < 1:
        raise UserError(f"--repeat {options.repeat}: must be at least 1")
    times = [in_new_process(measured, case, options.repeat) for case in CASES]
    page = page_of(times, in_new_process(measure_large, LARGE, min(options.repeat, 5)), options.repeat)
    print(page)
    if options.page is not None:
        write_section(options.page, SECTION, page)
    return 0


if __name__ == "__main__":
    run_command(main)
