"""The verdicts on all elements of a finished run."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from data.geometry.poses import xyzquat_to_poses
from data.plans.bim import IFC_SUFFIXES
from data.scene_graph import SceneGraph
from sgslam.as_built import planned_things
from sgslam.as_built.elements import ElementVerdict, element_verdicts
from sgslam.as_built.elements.sightings import View
from sgslam.session import Result


def verdicts_of(result: Result, bim: Path | None, a_graph: SceneGraph | None) -> list[ElementVerdict] | None:
    """The verdicts; None where the run is not anchored to an IFC model.

    Raises UserError for a model that cannot be read.
    """
    if bim is None or a_graph is None or result.T_bim_map is None or bim.suffix.lower() not in IFC_SUFFIXES:
        return None
    return run_verdicts(result, bim, a_graph)


def run_verdicts(result: Result, bim: Path, a_graph: SceneGraph) -> list[ElementVerdict]:
    """The verdicts on the elements of an IFC model, of a run that is anchored to it.

    Raises UserError for a model that cannot be read.
    """
    from data.plans.elements import planned_elements  # loads ifcopenshell

    tolerance, shared = result.config.as_built.tolerance, result.config.anchors.sigma_extraction
    return element_verdicts(planned_elements(bim), run_views(result), a_graph, tolerance, shared)


def without_planned_things(result: Result, bim: Path | None) -> Result:
    """The result without extra walls that are other things of an IFC model, such as stairs and railings.

    Raises UserError for a model that cannot be read.
    """
    is_ifc = bim is not None and bim.suffix.lower() in IFC_SUFFIXES
    if bim is None or not is_ifc or result.T_bim_map is None or all(d["kind"] != "extra" for d in result.deviations):
        return result
    from data.plans.elements import other_bodies  # loads ifcopenshell

    kept = planned_things.without_planned_things(
        result.deviations, result.s_graph, result.T_bim_map, other_bodies(bim)
    )  # fmt: skip
    return replace(result, deviations=kept)


def run_views(result: Result) -> list[View]:
    """The keyframes that have a cloud, in the BIM frame."""
    assert result.T_bim_map is not None
    keyframes = result.s_graph.keyframes
    poses = result.T_bim_map @ xyzquat_to_poses(np.array([keyframe.pose for keyframe in keyframes]))
    told = result.uncertainty
    nearest = np.clip(np.searchsorted(told.stamps_ns, [k.stamp_ns for k in keyframes]), 0, len(told.stamps_ns) - 1)
    sigma = np.nan_to_num(told.sigma[nearest, :2].max(axis=1), nan=np.inf)
    heading = np.nan_to_num(told.sigma[nearest, 5], nan=np.inf)
    return [
        View(points, T, float(own), float(turn))
        for keyframe, T, own, turn in zip(keyframes, poses, sigma, heading, strict=True)
        for points in [result.clouds[int(keyframe.id[1:])]] if len(points) and np.isfinite(own)
    ]  # fmt: skip
