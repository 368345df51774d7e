"""A self test for each native library; it fails if the library does not work on this machine."""

from collections.abc import Callable
from importlib.util import find_spec
from typing import Literal

import numpy as np


def _gtsam() -> None:
    import gtsam

    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    values.insert(0, gtsam.Pose3())
    graph.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(np.eye(4)), gtsam.noiseModel.Isotropic.Sigma(6, 0.1)))
    assert gtsam.LevenbergMarquardtOptimizer(graph, values).optimize().size() == 1


def _ifcopenshell() -> None:
    from data.ifc.self_test import work

    work()


def _embreex() -> None:
    from data.geometry.raycast import TriangleScene

    scene = TriangleScene(np.array([[[0.0, 0, 1], [4, 0, 1], [0, 4, 1]]]))
    assert abs(scene.distances(np.array([1.0, 1, 0]), np.array([[0.0, 0, 1]]))[0] - 1) < 1e-5


def _kiss_icp() -> None:
    _odometry("kiss")


def _small_gicp() -> None:
    _odometry("small_gicp")


def _odometry(method: Literal["kiss", "small_gicp"]) -> None:
    """Registers a box of 8 m twice from the same pose."""
    from sgslam.config import Config, OdometrySettings
    from sgslam.odometry import make_odometry

    box = np.random.default_rng(0).uniform(-4, 4, (6000, 3))
    sides = np.arange(len(box)), np.arange(len(box)) % 3
    box[sides] = np.sign(box[sides]) * 4
    odometry = make_odometry(Config(odometry=OdometrySettings(method=method)))
    assert odometry is not None
    found = [odometry.locate(stamp, box) for stamp in (0, 10**8)]
    assert np.allclose(found[-1], np.eye(4), atol=0.05)


def _shapely() -> None:
    import shapely

    assert shapely.box(0, 0, 1, 2).area == 2


def _opencv() -> None:
    import cv2

    assert cv2.distanceTransform(np.ones((3, 3), np.uint8), cv2.DIST_L2, 3).any()


def _weights() -> None:
    from data.generation.buildings import generate_plan
    from matching import Matcher

    Matcher.load("learned")
    if all(find_spec(needed) for needed in ("torch", "safetensors")):
        plan = generate_plan("apartment", 0).graph
        Matcher.load("paper").match(plan, plan)


SELF_TESTS: dict[str, Callable[[], None]] = {
    "gtsam": _gtsam, "ifcopenshell": _ifcopenshell, "embreex": _embreex,
    "kiss-icp": _kiss_icp, "small_gicp": _small_gicp, "shapely": _shapely, "opencv": _opencv,
    "the matchers' weights": _weights,
}  # fmt: skip
