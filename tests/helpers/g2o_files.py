"""A small building, and a factor graph of it as S-Graphs saves one, with all that is odd in such files."""

import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from boxes import Array, pose

from data import Room, SceneGraph, WallSurface
from data.geometry.poses import poses_to_xyzquat

PLACES = [(1, 1, 0), (3, 2, 0.4), (5, 1, -0.3), (8, 3, 0.9), (1, 5, 2.0), (3, 7, -2.0)]  # x, y and yaw of keyframes
ODD = """VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1
FIX 0
VERTEX_PLANE 1 -1 0 0 4 0.2 0.2 0.2
FIX 1
VERTEX_ROOM 2 2 1.5 0 0 0 0 1
FIX 2
VERTEX_FLOOR 90 0 0 3e-312 0 0 0 1
EDGE_SE3_PLANE 0 1 -1 0 0 4 1 0 0 1 0 1"""
ROOMS = {"a": (0.0, 0.0, 4.0, 3.0), "b": (4.2, 0.0, 9.2, 4.0), "c": (0.0, 3.2, 4.0, 7.7)}
T_BIM_MAP = pose(2.0, -1.0, 0.0, 0.3)


@dataclass(frozen=True)
class LoopBuilding:
    """`lines` of the file; the truth: T_bim_sensor of the keyframes, and which plane is which planned surface."""

    lines: list[str]
    plan: SceneGraph
    keyframes: dict[int, Array]
    pairs: dict[int, str]

    def write(self, folder: Path) -> tuple[Path, Path]:
        """The graph and the plan as files."""
        graph, plan = folder / "graph.g2o", folder / "plan.json"
        graph.write_text("\n".join(self.lines) + "\n")
        self.plan.save(plan)
        return graph, plan


def walls_of(name: str) -> list[tuple[str, Array, tuple[float, float], float]]:
    """(id, plane (4,) inwards, middle, length) of a room's walls, in the building."""
    x0, y0, x1, y1 = ROOMS[name]
    mx, my = (x0 + x1) / 2, (y0 + y1) / 2
    planes = np.array([[1, 0, 0, -x0], [-1, 0, 0, x1], [0, 1, 0, -y0], [0, -1, 0, y1]])
    middles, lengths = [(x0, my), (x1, my), (mx, y0), (mx, y1)], [y1 - y0, y1 - y0, x1 - x0, x1 - x0]
    return [(f"{name}{k}", planes[k], middles[k], lengths[k]) for k in range(4)]


def plan() -> SceneGraph:
    """The building's plan."""
    rooms = tuple(Room(name, ((x0 + x1) / 2, (y0 + y1) / 2)) for name, (x0, y0, x1, y1) in ROOMS.items())
    walls = [
        WallSurface(i, name, middle, (float(p[0]), float(p[1])), length)
        for name in ROOMS
        for i, p, middle, length in walls_of(name)
    ]
    return SceneGraph("bim", rooms, tuple(walls))


def drawn_graph(bend: float = 0.01, seed: int = 0) -> LoopBuilding:
    """Two keyframes in each room; what the file takes them to be is off by `bend` rad and 2 cm a step, as odometry is;
    the planes are seen to a millimetre. The plan stands in it too, as fixed vertices."""
    rng = np.random.default_rng(seed)
    T_bim = {100 + k: pose(x, y, 0.0, yaw) for k, (x, y, yaw) in enumerate(PLACES)}
    T_true = {i: np.linalg.inv(T_BIM_MAP) @ T for i, T in T_bim.items()}
    numbers, lines = list(T_bim), ODD.splitlines()
    steps, bent = [], {numbers[0]: T_true[numbers[0]]}
    for i, j in itertools.pairwise(numbers):
        step = np.linalg.inv(T_true[i]) @ T_true[j] @ pose(0.02, rng.normal(0, 0.005), 0.0, bend)
        bent[j] = bent[i] @ step
        information = "0.04 0 0 0 0 0 0.04 0 0 0 0 0.04 0 0 0 1.5 0 0 1.5 0 1.5"
        steps.append(f"EDGE_SE3:QUAT {i} {j} {words(poses_to_xyzquat(step))} {information}")
    lines += [f"VERTEX_SE3:QUAT {i} {words(poses_to_xyzquat(T))}" for i, T in bent.items()]
    pairs, seen, number = dict[int, str](), list[str](), 200
    for k, name in enumerate(ROOMS):
        ids = []
        for a_id, plane, _, _ in walls_of(name):
            ids.append(number)
            pairs[number] = a_id
            first = bent[100 + 2 * k]
            lines.append(f"VERTEX_PLANE {number} {words(in_map(first, T_bim[100 + 2 * k].T @ plane))} 0.2 0.2 0.2")
            for i in (100 + 2 * k, 101 + 2 * k):
                own = T_bim[i].T @ plane + np.array([0, 0, 0, rng.normal(0, 0.001)])
                seen.append(f"EDGE_SE3_PLANE {i} {number} {words(own)} 10 0 0 10 0 10")
            number += 1
        x0, y0, x1, y1 = ROOMS[name]
        centre = np.linalg.inv(T_BIM_MAP) @ [(x0 + x1) / 2, (y0 + y1) / 2, 0, 1]
        lines.append(f"VERTEX_ROOM {300 + k} {words(centre[:3])} 0 0 0 1")
        seen.append(f"EDGE_ROOM_4PLANES {300 + k} {' '.join(map(str, ids))} 3.3e-312 2.5e-312 0.1 0 0.1")
    return LoopBuilding([*lines, *steps, *seen, "EDGE_FLOOR_ROOM 90 300 1 2 1 3e-323 1"], plan(), T_bim, pairs)


def words(values: Array) -> str:
    """As in a file, to six digits after the point."""
    return " ".join(f"{value:.6f}" for value in np.asarray(values).tolist())


def in_map(T_map_sensor: Array, plane: Array) -> Array:
    return np.asarray(np.linalg.inv(T_map_sensor).T @ plane)
