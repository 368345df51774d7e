"""Alignments of a trajectory to the truth, as the literature on trajectory errors names them."""

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from sgslam.geometry.frames import inverse
from sgslam.report.accuracy import align_se3

Array = NDArray[np.float64]
Alignment = Literal["none", "se3", "origin"]


def align(estimate: Array, truth: Array, alignment: Alignment) -> Array:
    """The motion (4, 4) T_truth_estimate that is applied to the estimate before its errors are taken.

    `estimate` and `truth` are (M, 4, 4) poses of the same instants, M >= 1. `none`: the identity. `se3`: least
    squares over the positions (Umeyama, PAMI 1991), without scale. `origin`: the first poses coincide.

    Raises UserError where the motion of the poses does not determine the alignment, and for an unknown one.
    """
    if alignment == "none":
        return np.eye(4)
    if alignment == "se3":
        return align_se3(estimate[:, :3, 3], truth[:, :3, 3])
    if alignment == "origin":
        return truth[0] @ inverse(estimate[0])
    raise UserError(f"no alignment '{alignment}'; there are {', '.join(get_args(Alignment))}")
