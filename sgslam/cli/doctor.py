"""Checks what `pip check` and `sgslam run --demo` do not tell; exit code 1 if a check fails.

    python -m sgslam.cli.doctor

Our packages have common names, so that another distribution may hide them. Each native library runs a small self test
in a process of its own: one built for another processor does not raise an exception but kills its process.
"""

import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

from data.common.build import PACKAGES
from data.common.cli import Parser, run_command
from data.common.processes import cores, environment
from sgslam.own_packages import foreign_package

_LIMIT_S = 120.0  # of a self test, the library's import included
_DRIVE = (
    "from sgslam import Config; from sgslam.warm_up import warm_up; warm_up(Config(odometry=dict(method='{}')), False)"
)
SELF_TESTS = {  # lines of Python that fail where a native library does not work on this machine
    "gtsam": "import gtsam as g; g.LevenbergMarquardtOptimizer(g.NonlinearFactorGraph(), g.Values()).optimize()",
    "ifcopenshell": "from data.ifc.products import self_test; self_test()",
    "embreex": "from numpy import eye, zeros; from data.geometry.raycast import TriangleScene as Scene; "
    "Scene(eye(3)[None]).distances(zeros(3), eye(3))",
    "kiss-icp": _DRIVE.format("kiss"),
    "small_gicp": _DRIVE.format("small_gicp"),
    "shapely": "import shapely; shapely.box(0, 0, 1, 2).buffer(1)",
    "opencv": "import cv2, numpy; cv2.distanceTransform(numpy.ones((3, 3), numpy.uint8), cv2.DIST_L2, 3)",
    "the matcher's weights": "from matching import Matcher; Matcher.load('learned')",
}


def main(arguments: list[str] | None = None) -> int:
    """The command; returns 0 if all checks pass, else 1."""
    Parser(prog="python -m sgslam.cli.doctor", description="Check the installation.").parse_args(arguments)
    failed = 0
    with ThreadPoolExecutor(min(4, cores())) as pool:
        checks = {f"package {name}": foreign_package(name) for name in PACKAGES}
        for what, problem in [*checks.items(), *zip(SELF_TESTS, pool.map(run_self_test, SELF_TESTS), strict=True)]:
            print(f"{'FAIL ' if problem else 'ok   '} {what}{f': {problem}' if problem else ''}", flush=True)
            failed += problem is not None
    print("all checks passed" if not failed else f"{failed} {'check' if failed == 1 else 'checks'} failed")
    return 1 if failed else 0


def run_self_test(name: str) -> str | None:
    """Runs one of SELF_TESTS in a process of its own; returns what went wrong, None if nothing did."""
    line = [sys.executable, "-c", SELF_TESTS[name]]
    try:
        done = subprocess.run(line, env=environment(), capture_output=True, text=True, timeout=_LIMIT_S, check=False)
    except subprocess.TimeoutExpired:
        return f"did not finish within {_LIMIT_S:g} s"
    if done.returncode < 0:
        killed = f"its process was killed by {signal.Signals(-done.returncode).name}"
        return f"{killed}; the library may be built for another processor"
    return (done.stderr.strip().splitlines() or ["failed without a message"])[-1] if done.returncode else None


if __name__ == "__main__":
    run_command(main)
