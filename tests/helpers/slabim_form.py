"""A drive of our own in the form of SLABIM: three rooms, a session of scans, its stamps and its poses."""

import shutil
from pathlib import Path

import numpy as np
import trimesh
from drives import ROBOT, SENSOR

from data.simulation.simulate import simulate
from data.trajectory import Trajectory
from data.trajectory.stamps import ns_to_seconds

SITE = np.array([220.0, 25.0, 0.0])
FLOOR = (-0.2, -0.2, -0.2, 10.4, 7.4, 0.0)
WALLS = (  # three rooms, a doorway under a lintel from the first to each of the others
    (-0.2, -0.2, 0, 10.4, 0, 2.6), (-0.2, 7.2, 0, 10.4, 7.4, 2.6), (-0.2, 0, 0, 0, 7.2, 2.6),
    (10.2, 0, 0, 10.4, 7.2, 2.6), (6, 0, 0, 6.2, 1.5, 2.6), (6, 2.5, 0, 6.2, 7.2, 2.6), (6, 1.5, 2.1, 6.2, 2.5, 2.6),
    (0, 4, 0, 3, 4.2, 2.6), (4, 4, 0, 6, 4.2, 2.6), (3, 4, 2.1, 4, 4.2, 2.6),
)  # fmt: skip
SESSION = "3F_Region1"


def write_slabim(folder: Path) -> Path:
    """The data set's folder: the floor and the walls in files of their own, and the session."""
    root, mesh = folder / "SLABIM", folder / "SLABIM/BIM/3F/mesh"
    mesh.mkdir(parents=True)
    boxes = [trimesh.creation.box(bounds=np.reshape(b, (2, 3)) + SITE) for b in (FLOOR, *WALLS)]
    boxes[0].export(mesh / "floors.ply")
    trimesh.util.concatenate(boxes[1:]).export(mesh / "walls.ply")
    trimesh.util.concatenate(boxes).export(folder / "rooms.stl")
    run = simulate(folder / "rooms.stl", "", folder / "run", seed=1, min_rooms=3, min_length=12.0, sensor=SENSOR,
                   robot=ROBOT, scan_format="pcd")  # fmt: skip
    points = root / "sensor_data" / SESSION / "points"
    (points / "data").mkdir(parents=True)
    for k, path in enumerate(sorted((folder / "run/scans").glob("*.pcd"))):
        shutil.move(path, points / "data" / f"{k}.pcd")  # frame ids without leading zeros
    stamps = [int(t) + 1_722_400_926_400_290_300 for t in run.truth.stamps_ns]
    (points / "timestamps.txt").write_text("".join(f"{ns_to_seconds(t)}\n" for t in stamps))
    Trajectory(np.array(stamps), run.truth.poses).write_tum(points / "pose_frame_to_bim.txt")
    return root
