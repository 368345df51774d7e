"""A finished run, read from its folder, with its geometry in the frame of its `trajectory.tum`."""

import json
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.geometry.poses import xyzquat_to_poses
from data.scene_graph import Georeference, SceneGraph
from data.trajectory import Trajectory
from sgslam.as_built.elements.files import JSON as ELEMENTS
from sgslam.config import Config
from sgslam.config.loading import load_config
from sgslam.mapping import KeyframeClouds
from sgslam.mapping.keyframe_clouds import FILE as CLOUDS
from sgslam.mapping.keyframe_clouds import cloud_map

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RunFolder:
    """`s_graph` is in the map frame, `a_graph` (None where no plan was given) in the BIM frame; `T_bim_map` (4, 4) is
    None where the run was not anchored. `matches`, `deviations` and `metrics` have the forms of their files. With a
    `georeference`, exports are in map coordinates."""

    path: Path
    s_graph: SceneGraph
    a_graph: SceneGraph | None
    T_bim_map: Floats | None
    matches: dict[str, Any]
    deviations: list[dict[str, Any]]
    metrics: dict[str, Any] = field(default_factory=dict)
    georeference: Georeference | None = None

    @staticmethod
    def read(path: Path) -> "RunFolder":
        """Raises UserError for a folder that holds no run."""
        try:
            metrics, matches, deviations = (
                json.loads((path / f"{name}.json").read_text()) for name in ("metrics", "matches", "deviations")
            )
            pose = metrics["T_bim_map"]
            T_bim_map = None if pose is None else np.asarray(xyzquat_to_poses(np.array(pose, dtype=float)))
            if not isinstance(matches, dict) or not isinstance(deviations, list):
                raise TypeError
        except (OSError, KeyError, TypeError, ValueError):
            what = "deviations.json, metrics.json, matches.json"
            raise UserError(f"{path}: no run's folder ({what}); give a run's --out") from None
        plan = path / "a_graph.json"
        a_graph = SceneGraph.load(plan) if plan.is_file() else None
        s_graph = SceneGraph.load(path / "s_graph.json")
        return RunFolder(path, s_graph, a_graph, T_bim_map, matches, deviations, metrics)

    @cached_property
    def elements(self) -> list[dict[str, Any]]:
        """The entries of elements.json; empty where the run has none. Raises UserError for a damaged file."""
        return self._entries("elements", "progress")

    @cached_property
    def unplanned(self) -> list[dict[str, Any]]:
        """The walls that no plan shows, of elements.json; empty where the run has none. Raises as `elements`."""
        return self._entries("unplanned", "kind")

    def _entries(self, name: str, each_has: str) -> list[dict[str, Any]]:
        path = self.path / ELEMENTS
        if not path.is_file():
            return []
        try:
            entries: list[dict[str, Any]] = json.loads(path.read_text())[name]
            _ = [own[each_has] for own in entries]
        except (ValueError, KeyError, TypeError, AttributeError):
            raise UserError(f"{path}: is damaged or of an older version; run it again") from None
        return entries

    def anchored(self) -> tuple[SceneGraph, Floats]:
        """The A-graph and T_bim_map; raises UserError where the run was not anchored."""
        if self.a_graph is None or self.T_bim_map is None:
            raise UserError(f"{self.path}: the run was not anchored, so there are no deviations from the plan")
        return self.a_graph, self.T_bim_map

    def on_map(self) -> "RunFolder":
        """The same run with a `georeference`. Raises UserError where it is not known."""
        known = None if self.a_graph is None or self.T_bim_map is None else self.a_graph.georeference
        if known is None:
            why = "the run was not anchored" if self.T_bim_map is None else "its plan has no IfcMapConversion"
            raise UserError(f"{self.path}: has no map coordinates: {why}; leave out --georeferenced")
        return replace(self, georeference=known)

    @property
    def trajectory(self) -> Trajectory:
        """The content of `trajectory.tum`, on the map with a `georeference`."""
        found = Trajectory.read_tum(self.path / "trajectory.tum")
        return found if self.georeference is None else replace(found, poses=self.georeference.poses_on_map(found.poses))

    @cached_property
    def config(self) -> Config:
        """The settings of the run; raises UserError where its `config.yaml` cannot be read."""
        return load_config(self.path / "config.yaml", [])

    @property
    def frame(self) -> str:
        """`bim` where the run was anchored, else `map`: the frame of all geometry below."""
        return "map" if self.T_bim_map is None else "bim"

    @property
    def keyframe_poses(self) -> Floats:
        """(K, 4, 4) T_frame_sensor of the keyframes."""
        poses = xyzquat_to_poses(np.array([k.pose for k in self.s_graph.keyframes], dtype=float).reshape(-1, 7))
        return poses if self.T_bim_map is None else self.T_bim_map @ poses

    def map_points(self, voxel: float) -> tuple[Floats, Floats]:
        """The point cloud map (N, 3) in voxels of this side (m), and unit vectors (N, 3) towards the sensor. Raises
        UserError where the keyframes' clouds are missing."""
        numbers = [int(keyframe.id[1:]) for keyframe in self.s_graph.keyframes]
        poses = dict(zip(numbers, self.keyframe_poses, strict=True))
        return cloud_map(KeyframeClouds.open(self.path / CLOUDS), poses, voxel)
