"""Time of a match on one core, against the published model's forward pass.

Both run alternately in one process, on generated plans and drifting maps of the published sizes. The time is the
minimum CPU time of several runs, since a busy machine only adds to it. For a large plan also the peak memory of a
process of its own.
"""

import resource
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pydantic import PositiveInt
from threadpoolctl import threadpool_limits

from data.generation.buildings import generate_plan
from data.scene_graph import SceneGraph
from data.synthetic_maps.noise_models import draw
from evaluation.harness import Case, Cost, Options, Record, Study
from evaluation.harness.turns import in_turns, seconds_of
from matching import Matcher

MB = 1e6 if sys.platform == "darwin" else 1e3  # in units of ru_maxrss


class Choice(Options):
    """The number of runs of each method; of a large plan at most 5."""

    repeat: PositiveInt = 20


class TimeCase(Case):
    """A generated plan, reduced to `surfaces` wall surfaces (None: all), and a drifting map of `rooms` rooms.

    With `memory`, the learned matcher alone is measured, and the memory of the process.
    """

    kind: str
    seed: int
    surfaces: int | None
    rooms: int
    memory: bool = False
    repeat: int = 1

    def graphs(self) -> tuple[SceneGraph, SceneGraph]:
        """The S-graph and the A-graph."""
        from matching.training.data import part  # imports torch

        plan = generate_plan(self.kind, self.seed).graph
        a = plan if self.surfaces is None else part(plan, self.surfaces, np.random.default_rng(self.seed))
        return draw(a, "drift", np.random.default_rng(self.seed), self.rooms).s_graph, a


CASES = (
    TimeCase(kind="office", seed=500_009, surfaces=72, rooms=13),  # 95 and 69 nodes
    TimeCase(kind="corridor", seed=500_006, surfaces=319, rooms=51),  # 389 and 290
    TimeCase(kind="campus", seed=9833, surfaces=None, rooms=44, memory=True),  # 4,982 and about 200 wall surfaces
)


class Times(Record):
    """The numbers of nodes and wall surfaces, the answer, CPU seconds, and megabytes: the process's peak memory, and by
    how much the matching raised it. `first_s` is the first match of a plan."""

    plan_nodes: int
    map_nodes: int
    plan_surfaces: int
    map_surfaces: int
    answer: str
    match_s: Cost
    first_s: Cost
    forward_s: Cost = None
    published_s: Cost = None
    proposals_s: Cost = None
    peak_mb: Cost = None
    grown_mb: Cost = None


def cases(options: Choice) -> list[TimeCase]:
    """Two plans of the published sizes, and a large one."""
    repeats = [min(options.repeat, 5) if case.memory else options.repeat for case in CASES]
    return [case.model_copy(update={"repeat": repeat}) for case, repeat in zip(CASES, repeats, strict=True)]


def measure(case: TimeCase, work: Path) -> Times:
    """Measures everything in turns, on one thread."""
    s, a = case.graphs()
    learned = Matcher.load("learned")
    methods: dict[str, Callable[[], object]] = {"match_s": lambda: learned.match(s, a)}
    if not case.memory:
        from matching.learned import LearnedProposer
        from matching.published.forward import paper_forward  # imports torch, whose threads are limited below

        published, proposer = Matcher.load("paper"), LearnedProposer.load()
        methods |= {
            "forward_s": paper_forward(s, a), "published_s": lambda: published.match(s, a),
            "proposals_s": lambda: proposer.propose(s, a),
        }  # fmt: skip
    with threadpool_limits(1):
        # loads the machine code, or makes it
        Matcher.load("learned").match(*(CASES[0].graphs() if case.memory else (s, a)))
        before = _peak_mb()
        first_s = seconds_of(lambda: learned.match(s, a)).cpu
        times = in_turns(list(methods.values()), case.repeat, warm=not case.memory)
    memory = {"peak_mb": _peak_mb(), "grown_mb": _peak_mb() - before} if case.memory else {}
    return Times(
        plan_nodes=len(a.rooms) + len(a.wall_surfaces), map_nodes=len(s.rooms) + len(s.wall_surfaces),
        plan_surfaces=len(a.wall_surfaces), map_surfaces=len(s.wall_surfaces), answer=learned.match(s, a).status,
        first_s=first_s, **memory,
        **{name: min(one.cpu for one in own) for name, own in zip(methods, times, strict=True)},
    )  # fmt: skip


def _peak_mb() -> float:
    """The peak memory of this process."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / MB


def tables(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """The times of the published sizes, and time and memory of a large plan."""
    return {
        "times": pd.DataFrame([_times(row) for row in rows[~rows.memory].itertuples()]),
        "large": pd.DataFrame([_large(row) for row in rows[rows.memory].itertuples()]),
    }


def _times(row: Any) -> dict[str, str]:
    seconds = {
        "published forward": row.forward_s, "published, whole": row.published_s, "match": row.match_s,
        "of it proposals": row.proposals_s, "plan's part, once": max(row.first_s - row.match_s, 0.0),
    }  # fmt: skip
    return {
        "nodes of plan and map": f"{row.plan_nodes} and {row.map_nodes}",
        "wall surfaces": f"{row.plan_surfaces} and {row.map_surfaces}",
        **{f"{name} (ms)": f"{1e3 * value:.1f}" for name, value in seconds.items()},
        "match / forward": f"{row.match_s / row.forward_s:.1f}", "answer": row.answer,
    }  # fmt: skip


def _large(row: Any) -> dict[str, str]:
    return {
        "wall surfaces of plan and map": f"{row.plan_surfaces} and {row.map_surfaces}",
        "match (s)": f"{row.match_s:.2f}", "first match, the plan's part as well (s)": f"{row.first_s:.2f}",
        "memory at most (MB)": f"{row.peak_mb:.0f}", "of it for the matching (MB)": f"{row.grown_mb:.0f}",
        "answer": row.answer,
    }  # fmt: skip


STUDY = Study(
    name="matching_time",
    asks="how long a match takes beside the published model's forward pass, and its memory",
    options=Choice,
    quick=Choice(repeat=5),
    case=TimeCase,
    record=Times,
    cases=cases,
    measure=measure,
    tables=tables,
    timed=True,
)
