"""The command that times a match beside the published forward pass."""

import subprocess
import sys

import pytest

from evaluation.matching_benchmark.timing import (
    CASES,
    Case,
    Large,
    Times,
    in_new_process,
    measure_large,
    measured,
    page_of,
)

SMALL = Case("apartment", 3, None, 3)


def test_sizes_are_the_published_ones():
    s, a = CASES[0].graphs()
    assert (len(a.rooms) + len(a.wall_surfaces), len(s.rooms) + len(s.wall_surfaces)) == (95, 69)


@pytest.mark.slow
def test_everything_is_timed():
    t = in_new_process(measured, SMALL, 1)
    assert min(t.forward, t.published, t.proposals, t.match, t.first) > 0  # which is longer, one run cannot tell
    assert t.surfaces == tuple(len(g.wall_surfaces) for g in SMALL.graphs()[::-1])


def test_memory_is_the_most_that_was_held():
    large = measure_large(SMALL, 1)
    assert large.memory > 50 and large.grown >= 0 and large.match > 0


def test_the_page_tells_the_ratio():
    t = Times((95, 69), (77, 57), 0.002, 0.01, 0.012, 0.005, 0.02, "unique")
    page = page_of([t], Large((5000, 200), 0.4, 2.0, 900.0, 300.0, "unique"), 3)
    assert "| 95 and 69 |" in page and "| 6.0 |" in page and "| 900 |" in page and "least of 3" in page


@pytest.mark.slow
def test_a_number_of_runs_below_one_is_refused():
    command = [sys.executable, "-m", "evaluation.matching_benchmark.timing", "--repeat", "0"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 2 and "must be at least 1" in done.stderr
