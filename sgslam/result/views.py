"""What the keyframes of an anchored run saw of the building, as evidence for verdicts on planned elements."""

import numpy as np
from numpy.typing import NDArray

from data.geometry.poses import xyzquat_to_poses
from data.scene_graph import SceneGraph
from sgslam.as_built.elements.rays import View
from sgslam.mapping import KeyframeClouds
from sgslam.session.soundness.scan_uncertainty import ScanUncertainty


def keyframe_views(
    s_graph: SceneGraph, T_bim_map: NDArray[np.float64], scans: ScanUncertainty, clouds: KeyframeClouds
) -> list[View]:
    """The keyframes that have a cloud, in the BIM frame; `T_bim_map` is (4, 4)."""
    keyframes = s_graph.keyframes
    poses = T_bim_map @ xyzquat_to_poses(np.array([keyframe.pose for keyframe in keyframes]))
    nearest = np.clip(np.searchsorted(scans.stamps_ns, [k.stamp_ns for k in keyframes]), 0, len(scans.stamps_ns) - 1)
    sigma = scans.sigma[nearest, :3]
    heading = np.nan_to_num(scans.sigma[nearest, 5], nan=np.inf)
    views = []
    for keyframe, T, own, turn in zip(keyframes, poses, sigma, heading, strict=True):
        points = clouds[int(keyframe.id[1:])]
        if len(points) and np.isfinite(own).all():
            views.append(View(points, T, own, float(turn)))
    return views
