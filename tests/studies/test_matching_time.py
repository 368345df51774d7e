"""The study that times a match beside the published forward pass."""

from pathlib import Path

import pandas as pd
import pytest

from evaluation.matching_benchmark.timing import CASES, STUDY, Choice, TimeCase, cases, measure

SMALL = TimeCase(kind="apartment", seed=3, surfaces=None, rooms=3)


def test_sizes_are_the_published_ones() -> None:
    s, a = CASES[0].graphs()
    assert (len(a.rooms) + len(a.wall_surfaces), len(s.rooms) + len(s.wall_surfaces)) == (95, 69)


@pytest.mark.slow
def test_everything_is_timed_and_told(tmp_path: Path) -> None:
    small, large = SMALL, SMALL.model_copy(update={"memory": True})
    times, memory = measure(small, tmp_path), measure(large, tmp_path)
    costs = (times.forward_s, times.published_s, times.proposals_s, times.match_s, times.first_s)
    assert all(seconds is not None and seconds > 0 for seconds in costs)  # which is longer, one run cannot tell
    s, a = SMALL.graphs()
    assert (times.plan_surfaces, times.map_surfaces) == (len(a.wall_surfaces), len(s.wall_surfaces))
    assert memory.peak_mb is not None and memory.peak_mb > 50 and memory.grown_mb is not None and memory.grown_mb >= 0
    assert memory.forward_s is None and times.peak_mb is None
    fast = times.model_copy(update={"forward_s": 0.002, "match_s": 0.012})
    rows = ((small, fast), (large, memory))
    tables = STUDY.tables(pd.DataFrame([{**case.model_dump(), **record.model_dump()} for case, record in rows]))
    assert tables["times"]["match / forward"].tolist() == ["6.0"]
    assert tables["large"]["memory at most (MB)"].tolist() == [f"{memory.peak_mb:.0f}"]


def test_a_large_plan_is_repeated_less() -> None:
    assert [case.repeat for case in cases(Choice(repeat=9))] == [9, 9, 5]
