"""The map of earlier runs, in which a new run is relocalised and into which it is merged."""

import logging
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph, UserError
from sgslam.anchoring import align_walls
from sgslam.anchoring.wall_alignment import planar_pose
from sgslam.backend import Backend
from sgslam.config import Config
from sgslam.geometry.frames import inverse, level_map, transform_planes, transform_points
from sgslam.mapping import FloorMap, Floors, KeyframeClouds
from sgslam.mapping.keyframe_clouds import FILE as CLOUDS
from sgslam.serialization import unpack
from sgslam.session.active_map import ActiveMap
from sgslam.session.checkpoints import FILE, read_run
from sgslam.session.scan_poses import ScanPose

Floats = NDArray[np.float64]
_SAME_FLOOR = 1.0  # m of height between two floors that are the same
_log = logging.getLogger(__name__)


@dataclass
class PriorMap:
    """A map with one connected factor graph.

    `begins` are the indices in `scans` at which its runs begin; `height` (m) is the sensor's height above the floor;
    `T_bim_map` (4, 4) is None if the map is not anchored, and so is `first_anchor_ns`, the stamp since which it is.
    """

    backend: Backend
    floors: Floors
    scans: list[ScanPose]
    begins: list[int]
    height: float
    T_bim_map: Floats | None
    first_anchor_ns: int | None
    clouds: KeyframeClouds

    @staticmethod
    def load(folder: Path, config: Config) -> "PriorMap":
        """Loads the map of a finished run's folder. Raises UserError if there is none or it is damaged."""
        about, state = read_run(folder)
        if not about.get("finished"):
            raise UserError(f"{folder}: that run was interrupted; finish it with --resume before using its map")
        path, voxel = folder / CLOUDS, config.clouds.keyframe_voxel
        clouds = KeyframeClouds.open(path, voxel=voxel) if path.is_file() else KeyframeClouds(voxel=voxel)
        try:
            return PriorMap.of(unpack(state["map"], config, clouds=clouds)[1])
        except ValueError as error:
            raise UserError(f"{folder / FILE}: damaged, or of another version ({error}); run it again") from None

    @staticmethod
    def of(active: ActiveMap) -> "PriorMap":
        """The map that a run has built."""
        return PriorMap(
            active.backend,
            active.floors,
            active.scans,
            active.begins,
            active.transition.height,
            active.T_bim_map,
            active.first_anchor_ns if active.T_bim_map is not None else None,
            active.clouds,
        )

    def plan_in(self, bim: SceneGraph | None) -> tuple[SceneGraph, Floats, bool]:
        """The plan to relocalise a run in, (4, 4) this map in its frame, and whether it is this map.

        If the map is anchored and a BIM is given, the BIM is the plan: then the runs need not share any rooms.
        """
        if bim is not None and self.T_bim_map is not None:
            return bim, self.T_bim_map, False
        return self.plan(), self.T_plan_map, True

    @property
    def T_plan_map(self) -> Floats:  # noqa: N802
        """(4, 4) the map in the frame of `plan`: levelled, with its first floor at z = 0."""
        return level_map(self.floors.maps[0].plane_in_map, self.height)

    def plan(self) -> SceneGraph:
        """The S-graph in the form of a plan, for relocalising a run in it."""
        graph = self.floors.graph([], [floor.scene for floor in self.floors.maps if floor.scene is not None])
        planes = _planes(self.floors).items()
        elevation = {f"floor-{number}": float(_foot(self.T_plan_map, plane)[2]) for number, plane in planes}
        walls = tuple(replace(surface, plane=None) for surface in graph.wall_surfaces)
        floors = tuple(replace(floor, elevation=elevation.get(floor.id, 0.0)) for floor in graph.floors)
        return replace(graph, frame="bim", wall_surfaces=walls, floors=floors, keyframes=())

    def join(self, other: "PriorMap", T_map_other: Floats, config: Config, same_run: bool = False) -> None:
        """Merges another map at `T_map_other` (4, 4) into this one; walls that both have seen become one.

        `other` must not be used afterwards. `same_run`: both are submaps of one run.
        """
        storeys = self._storeys(other, T_map_other)
        same = self._same_walls(other, T_map_other, storeys, config)
        first, numbered = len(self.backend.keyframes), self.floors.register.count
        levels = self.floors.level_register.count
        wall_of = {wall: same.get(wall, wall + numbered) for wall in range(other.floors.register.count)}
        for floor in other.floors.maps:
            if storeys[floor.number] == len(self.floors.maps):
                begun = self.floors.begin()
                begun.walls.T_level_map = floor.walls.T_level_map @ inverse(T_map_other)
            known = self.floors.maps[storeys[floor.number]]
            known.walls.absorb(floor.walls, first, wall_of)
            known.levels.absorb(floor.levels, first, levels, T_map_other)
        self.floors.register.count += other.floors.register.count
        self.floors.level_register.count += other.floors.level_register.count
        self.backend.absorb(other.backend, T_map_other, len(self.scans), storeys, levels)
        for wall, plane in other.backend.planes_in_map.items():
            self.backend.planes_in_map.setdefault(wall_of[wall], transform_planes(T_map_other, plane))
        self._append_scans(other, T_map_other, first)
        if not same_run:
            self.begins = self.begins + [len(self.scans) - len(other.scans) + begin for begin in other.begins]
        self._append_clouds(other, first, same_run)
        count = len(other.backend.keyframes)
        _log.info("merged %d keyframes into a map of %d; %d walls seen in both", count, first, len(same))
        for floor in self.floors.maps:  # floors that both have seen become one while the two maps are where they belong
            floor.levels.refresh(self.backend.levels_in_map, self.backend.poses)
        for _ in range(6):  # at most
            self.backend.optimise(self.floors.seen, self.floors.levels, [], None, steps=20)
            walls = len({s.wall for s in self.floors.seen})
            self.floors.refresh(*self.backend.estimates, self.height, last=False)
            if len({s.wall for s in self.floors.seen}) == walls:
                break
        for floor in self.floors.maps:
            floor.cut(self.backend.keyframes, config)

    def _storeys(self, other: "PriorMap", T_map_other: Floats) -> dict[int, int]:
        """Floor numbers of this map by those of another one: the floor at the same height, else a new number."""
        T, own, storeys = self.T_plan_map, _planes(self.floors), dict[int, int]()
        heights = {number: float(_foot(T, plane)[2]) for number, plane in own.items()}
        for floor in other.floors.maps:
            plane = floor.plane_in_map
            free = [n for n in heights if n not in storeys.values()]
            z = 0.0 if plane is None else float(_foot(T, transform_planes(T_map_other, plane))[2])
            nearest = min(free, key=lambda n: abs(heights[n] - z), default=None)
            beyond = len(self.floors.maps) + sum(n >= len(self.floors.maps) for n in storeys.values())
            near = nearest is not None and (plane is None or abs(heights[nearest] - z) < _SAME_FLOOR)
            storeys[floor.number] = nearest if near and nearest is not None else beyond
        return storeys

    def _same_walls(
        self, other: "PriorMap", T_map_other: Floats, storeys: dict[int, int], config: Config
    ) -> dict[int, int]:
        """Walls of this map by the same walls of another one, where the two maps agree on their position."""
        plan, same = self.plan(), dict[int, dict[int, float]]()
        origin = np.array(plan.centroid())
        for floor in other.floors.maps:
            known = self.floors.maps[storeys[floor.number]] if storeys[floor.number] < len(self.floors.maps) else None
            if known is None or known.scene is None or floor.scene is None:
                continue
            T = self.T_plan_map @ T_map_other @ inverse(floor.walls.T_level_map)
            place = planar_pose(T) - np.array([0.0, *origin])
            alignment = align_walls(floor.scene, floor.walls, plan.on_floor(_id(known)), origin, place, config.anchors)
            for held in alignment.walls if alignment is not None else ():
                if held.agrees:
                    votes = same.setdefault(floor.scene.wall_of_surface[held.surface.id], {})
                    wall = known.scene.wall_of_surface[held.planned.id]
                    votes[wall] = votes.get(wall, 0.0) + (held.surface.length or 0.0)
        return {wall: max(votes, key=lambda w: votes[w]) for wall, votes in same.items()}

    def _append_scans(self, other: "PriorMap", T_map_other: Floats, keyframes: int) -> None:
        begins = set(other.begins) | {0}
        for i, scan in enumerate(other.scans):
            T = T_map_other @ scan.T_map_sensor
            previous = None if i in begins else scan.T_previous_sensor
            own = replace(scan, T_map_sensor=T, keyframe=scan.keyframe + keyframes, T_previous_sensor=previous)
            self.scans.append(own)

    def _append_clouds(self, other: "PriorMap", keyframes: int, same_run: bool) -> None:
        if not same_run:  # the file of the other run stays as it is
            earlier, self.clouds = self.clouds, KeyframeClouds(voxel=self.clouds.voxel)
            self.clouds.take(earlier)
        self.clouds.take(other.clouds, keyframes)


def _foot(T: Floats, plane: Floats) -> Floats:
    """(3,) the point of a plane (4,) nearest to the map's origin, transformed by `T` (4, 4)."""
    return np.asarray(transform_points(T, -plane[3] * plane[:3]))


def _planes(floors: Floors) -> dict[int, Floats]:
    """The planes (4,) in the map of the floors that were seen, by number."""
    return {floor.number: floor.plane_in_map for floor in floors.maps if floor.plane_in_map is not None}


def _id(floor: FloorMap) -> str:
    return f"floor-{floor.number}"
