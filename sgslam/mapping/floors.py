"""The floors of a run: walls and scene of each, and the S-graph of all floors."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data import Keyframe, SceneGraph
from data.geometry.poses import poses_to_xyzquat
from sgslam.config import Config
from sgslam.geometry.frames import level_map
from sgslam.mapping.keyframes import KeyframeNode, RoomNode
from sgslam.mapping.level_map import LevelMap, Register, SeenLevel
from sgslam.mapping.scene import Scene, build_scene
from sgslam.mapping.wall_map import SeenWall, WallMap

Floats = NDArray[np.float64]
_SCENE, _UNPLACED = 16, 3  # keyframes between two segmentations of rooms, and while the map is not placed
_GROWTH = 0.25  # of the keyframes of a floor, by which it grows between them


@dataclass
class FloorMap:
    """One floor of the S-graph: its walls and level surfaces.

    `plane_in_map` (4,) is that of the floor itself, None until it was seen; `sensor_height` (m) is the sensor's usual
    one above it, as far as known. `scene` holds the rooms and wall surfaces of the last `cut`, None before.
    """

    number: int
    walls: WallMap
    levels: LevelMap
    plane_in_map: Floats | None = None
    sensor_height: float = 0.0
    scene: Scene | None = None

    def find_floor(self, sensor_height: float) -> None:
        """Takes the newest estimate of the floor's plane and levels the map by it. Until it was seen, the first floor
        is `sensor_height` (m) below the first pose, another one where the transition says."""
        self.sensor_height, level = sensor_height, self.levels.floor()
        self.plane_in_map = None if level is None else self.levels.planes_in_map[level]
        if self.plane_in_map is not None or not self.number:
            self.walls.T_level_map = level_map(self.plane_in_map, sensor_height)

    def scene_now(self, keyframes: list[KeyframeNode], config: Config) -> Scene:
        """Rooms and wall surfaces from the present estimates of all keyframes, without changing `scene`."""
        return build_scene(keyframes, self.walls, self.plane_in_map, config, self.number)

    def cut(self, keyframes: list[KeyframeNode], config: Config) -> None:
        """Updates `scene`: segments the rooms and the wall surfaces again."""
        self.scene = self.scene_now(keyframes, config)


class Floors:
    """All floors in the order of their first observation; `current` is the robot's, or on a stair the one it left."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self.register, self.level_register = Register(), Register()
        self.maps: list[FloorMap] = []
        self.current = self.begin()

    def begin(self) -> FloorMap:
        """Adds a floor and makes it the current one."""
        number = len(self.maps)
        levels = LevelMap(self._config.levels, self.level_register)
        self.current = FloorMap(number, WallMap(self._config.surfaces, self.register), levels)
        self.maps.append(self.current)
        return self.current

    @property
    def seen(self) -> list[SeenWall]:
        """The wall observations of all floors in the order in which they were made."""
        return sorted((s for floor in self.maps for s in floor.walls.seen), key=lambda s: s.keyframe)

    @property
    def levels(self) -> list[SeenLevel]:
        """The observations of level surfaces of all floors."""
        return [seen for floor in self.maps for seen in floor.levels.seen]

    @property
    def rooms(self) -> list[RoomNode]:
        """The rooms of all floors' scenes."""
        return [room for floor in self.maps if floor.scene is not None for room in floor.scene.rooms]

    def due(self, keyframes: list[KeyframeNode], unplaced: bool) -> bool:
        """Whether the current floor has grown enough for another `cut`.

        Sooner while it is `unplaced` in the plan.
        """
        own, scene = sum(k.storey == self.current.number for k in keyframes), self.current.scene
        least = _UNPLACED if unplaced else _SCENE
        grown = own - (0 if scene is None else len(scene.graph.keyframes))
        return grown >= max(least, _GROWTH * own)

    def refresh(
        self, poses: Floats, walls: dict[int, Floats], levels: dict[int, Floats], height: float, last: bool
    ) -> None:
        """Updates the walls from the newest estimates, joins duplicates and splits walls with a step.

        `poses` (K, 4, 4) are T_map_sensor of all keyframes, `walls` and `levels` the planes (4,) in the map by number.
        `height` (m) is the sensor's above the floor. At the `last` time walls are not split, since the graph has them.
        """
        for floor in self.maps:
            floor.levels.refresh(levels, poses)
            floor.find_floor(height)
            floor.walls.refresh(poses, walls)
            if not last and floor.walls.split_steps():
                floor.walls.refresh(poses, walls)
            if floor.walls.join_duplicates() and floor.scene is not None:
                floor.scene = floor.scene.relabelled(floor.walls.current)

    def graph(self, keyframes: list[KeyframeNode], scenes: list[Scene]) -> SceneGraph:
        """The S-graph of all `scenes` in the map frame, with the keyframes on stairs."""
        graphs = [scene.graph for scene in scenes]
        between = {i: k for i, k in enumerate(keyframes) if k.storey is None}
        if len(graphs) == 1 and not between:
            return graphs[0]
        poses = {i: tuple(poses_to_xyzquat(k.T_map_sensor).tolist()) for i, k in between.items()}
        on_stairs = [Keyframe(f"k{i}", k.stamp_ns, poses[i]) for i, k in between.items()]
        taken = [*(k for g in graphs for k in g.keyframes), *on_stairs]
        return SceneGraph(
            "map",
            tuple(room for g in graphs for room in g.rooms),
            tuple(surface for g in graphs for surface in g.wall_surfaces),
            tuple(door for g in graphs for door in g.doors),
            tuple(floor for g in graphs for floor in g.floors),
            tuple(sorted(taken, key=lambda k: k.stamp_ns)),
        )
