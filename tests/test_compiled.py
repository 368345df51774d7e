"""The compiled loops against numpy and scipy, which say the same more slowly."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from data.common.compiled import compiled
from data.common.processes import environment
from sgslam.geometry.normal_equations import add_row, solved
from sgslam.tracking.floor_transition import nearest_in_plan

RNG = np.random.default_rng(4)


@pytest.mark.parametrize("size", [1, 3, 6])
def test_normal_equations_are_those_of_least_squares(size: int) -> None:
    J, off, weight = RNG.normal(size=(20, size)), RNG.normal(size=20), RNG.uniform(0.1, 2.0, 20)
    H, g = np.zeros((size, size)), np.zeros(size)
    for row in zip(J, off, weight, strict=True):
        add_row(H, g, *row)
    root = np.sqrt(weight)[:, None]
    expected, *_ = np.linalg.lstsq(root * J, root[:, 0] * off, rcond=None)
    assert solved(H, g) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(("points", "known", "spread"), [(1, 1, 0.01), (40, 300, 0.3), (300, 40, 2.0), (200, 900, 1e4)])
def test_nearest_in_plan_is_what_a_tree_says(points: int, known: int, spread: float) -> None:
    asked, told = RNG.normal(0.0, 0.5, (points, 3)), RNG.normal(0.0, spread, (known, 3))
    told[0, :2] = asked[0, :2] + 0.02
    distance, nearest = cKDTree(told[:, :2]).query(asked[:, :2], distance_upper_bound=0.08)
    found = nearest_in_plan(asked, told, 0.08)
    assert np.array_equal(found, np.where(np.isfinite(distance), nearest, -1))
    assert found[0] >= 0


def test_nothing_known_is_near_nothing() -> None:
    assert np.array_equal(nearest_in_plan(np.zeros((2, 3)), np.empty((0, 3)), 0.08), [-1, -1])


def test_what_cannot_be_kept_on_disk_is_compiled_all_the_same() -> None:
    names: dict[str, object] = {}
    exec("def twice(x):\n    return 2 * x", names)  # of no file, so there is no place beside it
    assert compiled(names["twice"])(21.0) == 42.0  # type: ignore[type-var, operator]


INNER = "from data.common.compiled import compiled\n\nSUM = {}\n\n@compiled\ndef inner(x):\n    return {} * x\n"
CALLER = """
from data.common.compiled import compiled
from inner import SUM, inner

@compiled
def outer(x):
    return inner(x) + SUM
"""


def test_after_an_update_nothing_old_is_loaded(tmp_path: Path) -> None:
    """Of functions that are called, and of numbers, though the file of the caller stays as it was."""
    (tmp_path / "caller.py").write_text(CALLER)
    told = []
    for number, factor in ((0.0, 2), (0.0, 30), (5.0, 30)):
        (tmp_path / "inner.py").write_text(INNER.format(number, factor))
        command = [sys.executable, "-B", "-c", "from caller import outer; print(outer(21.0))"]
        done = subprocess.run(command, cwd=tmp_path, env=environment(), capture_output=True, text=True, check=True)
        told.append(float(done.stdout))
    assert told == [42.0, 630.0, 635.0]
