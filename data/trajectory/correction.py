"""Carries the correction of some poses over to all poses of a trajectory."""

import numpy as np

from data.trajectory.trajectory import Trajectory


def moved_with(given: Trajectory, corrected: Trajectory) -> Trajectory:
    """All poses of `given` in the frame of `corrected`, which holds some of them, corrected.

    Between two corrected poses the correction is interpolated over time; before the first and after the last it is
    theirs. Raises ValueError where `corrected` is empty.
    """
    if not len(corrected):
        raise ValueError("trajectory: no corrected pose")
    if len(given) < 2:
        return Trajectory(corrected.stamps_ns, corrected.poses)
    corrections = corrected.poses @ np.linalg.inv(given.at(corrected.stamps_ns))
    if len(corrected) == 1:
        return given.transformed(corrections[0])
    # about the middle of the way: far from zero, a turn that is interpolated would move the poses
    middle = np.eye(4)
    middle[:3, 3] = given.positions.mean(axis=0)
    local = Trajectory(corrected.stamps_ns, np.linalg.inv(corrections[0] @ middle) @ corrections @ middle)
    stamps = np.clip(given.stamps_ns, corrected.stamps_ns[0], corrected.stamps_ns[-1])
    return Trajectory(given.stamps_ns, corrections[0] @ middle @ local.at(stamps) @ np.linalg.inv(middle) @ given.poses)
