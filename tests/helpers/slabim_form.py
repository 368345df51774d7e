"""A drive of our own in the form of SLABIM: three rooms, a session of scans, its stamps and its poses."""

import shutil
from pathlib import Path

import numpy as np
import trimesh
from drives import CARRIER, SENSOR

from data.simulation.simulate import simulate
from data.trajectory import Trajectory
from data.trajectory.stamps import ns_to_seconds

SITE = np.array([220.0, 25.0, 0.0])
FLOOR = (-0.2, -0.2, -0.2, 10.4, 7.4, 0.0)
TOP = 2.6
SOUTH_AND_NORTH = ((-0.2, -0.2, 0, 10.4, 0, TOP), (-0.2, 7.2, 0, 10.4, 7.4, TOP))
WEST_AND_EAST = ((-0.2, 0, 0, 0, 7.2, TOP), (10.2, 0, 0, 10.4, 7.2, TOP))
TO_THE_EAST = ((6, 0, 0, 6.2, 1.5, TOP), (6, 2.5, 0, 6.2, 7.2, TOP), (6, 1.5, 2.1, 6.2, 2.5, TOP))  # under a lintel
TO_THE_NORTH = ((0, 4, 0, 3, 4.2, TOP), (4, 4, 0, 6, 4.2, TOP), (3, 4, 2.1, 4, 4.2, TOP))
WALLS = SOUTH_AND_NORTH + WEST_AND_EAST + TO_THE_EAST + TO_THE_NORTH  # three rooms
SESSION = "3F_Region1"


def write_slabim(folder: Path) -> Path:
    """The data set's folder: the floor and the walls in files of their own, and the session."""
    root, mesh = folder / "SLABIM", folder / "SLABIM/BIM/3F/mesh"
    mesh.mkdir(parents=True)
    boxes = [trimesh.creation.box(bounds=np.reshape(b, (2, 3)) + SITE) for b in (FLOOR, *WALLS)]
    boxes[0].export(mesh / "floors.ply")
    trimesh.util.concatenate(boxes[1:]).export(mesh / "walls.ply")
    trimesh.util.concatenate(boxes).export(folder / "rooms.stl")
    run = simulate(folder / "rooms.stl", "", folder / "run", 1, 3, 12.0, SENSOR, CARRIER, scan_format="pcd")
    points = root / "sensor_data" / SESSION / "points"
    (points / "data").mkdir(parents=True)
    for k, path in enumerate(sorted((folder / "run/scans").glob("*.pcd"))):
        shutil.move(path, points / "data" / f"{k}.pcd")  # frame ids without leading zeros
    stamps = [int(t) + 1_722_400_926_400_290_300 for t in run.truth.stamps_ns]
    (points / "timestamps.txt").write_text("".join(f"{ns_to_seconds(t)}\n" for t in stamps))
    Trajectory(np.array(stamps), run.truth.poses).write_tum(points / "pose_frame_to_bim.txt")
    return root
