"""What emulates another processor takes effect, and the odometry's library gives the same bits on both."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from other_cpu import VARIABLES, X86, told, without_avx512

from data.common.processes import environment

HELPERS = Path(__file__).parents[1] / "helpers"
pytestmark = pytest.mark.skipif(not X86, reason="x86-64 alone has AVX-512")
KISS = """
import hashlib
import numpy as np
from kiss_icp.pybind.kiss_icp_pybind import _Registration, _Vector3dVector, _VoxelHashMap, _voxel_down_sample

# whole steps of 2**-20, so that the input is the same to the bit whoever makes it
rng = np.random.default_rng(0)
points = rng.integers(-4 << 20, 4 << 20, (20000, 3)) * 2.0**-20
points[::2, 0], points[1::2, 1] = 4.0, -3.0
thin = np.asarray(_voxel_down_sample(_Vector3dVector(points), 0.5))
known = _VoxelHashMap(1.0, 60.0, 20)
known._add_points(_Vector3dVector(points))
guess = np.eye(4)
guess[:3, 3] = 0.125, -0.25, 0.0625
found = _Registration(100, 1e-4, 1)._align_points_to_map(_Vector3dVector(thin), known, guess, 3.0, 1.0)
print(hashlib.sha256(thin.tobytes() + found.tobytes()).hexdigest())
"""


def said(code: str, variables: dict[str, str]) -> str:
    """By a process for which these are set."""
    clean = {name: value for name, value in environment().items() if name not in VARIABLES}
    line = [sys.executable, "-c", code]
    return subprocess.run(line, env=clean | variables, capture_output=True, text=True, check=True, cwd=HELPERS).stdout


def test_the_variables_take_the_place_of_the_processor() -> None:
    code = "import json, other_cpu; print(json.dumps(other_cpu.without_avx512()))"
    assert json.loads(said(code, VARIABLES)) == dict.fromkeys(VARIABLES, True)


def test_in_this_run_too() -> None:
    """Where they are set by whoever runs the tests."""
    assert "NPY_DISABLE_CPU_FEATURES" in told() or "NPY_DISABLE_CPU_FEATURES" not in os.environ
    held = without_avx512() if told() else {}
    assert all(held[name] for name in told())


def test_kiss_icp_gives_the_same_bits_on_both() -> None:
    """On one thread, which is what we ask for: where drives differ, numpy's sums do."""
    assert said(KISS, VARIABLES) == said(KISS, {})
