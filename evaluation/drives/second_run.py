"""A second run in the map of a first one: the first run's map, and what happens to the second while it runs."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.common.build import content_hash
from data.common.errors import UserError
from data.scans import ScanFolder
from data.scene_graph import SceneGraph
from data.trajectory import Trajectory
from evaluation.drives.buildings import locked
from evaluation.drives.runs import run_through
from evaluation.drives.sequences import Sequence
from evaluation.metrics.trajectories import WRONG
from sgslam.config import Config
from sgslam.geometry.frames import inverse
from sgslam.mapping.keyframe_clouds import FILE as CLOUDS
from sgslam.session import Checkpoints
from sgslam.session.checkpoints import FILE
from sgslam.slam import SceneGraphSlam

Array = NDArray[np.float64]


def first_run(sequence: Sequence, anchored: bool, config: Config, work: Path) -> tuple[Path, Trajectory]:
    """The folder of this build's map of the drive, made if it is missing, and the run's trajectory.

    If `anchored`, the run gets the plan, and its trajectory is in the BIM frame. Raises UserError if it could not be
    anchored.
    """
    plan = "plan" if anchored else "no-plan"
    name = f"{sequence.name}-{sequence.seed}-{plan}-{config.matching.method}-{content_hash()}"
    folder = work / "maps" / name
    with locked(folder):
        if not (folder / FILE).is_file():
            folder.mkdir(exist_ok=True)
            slam = SceneGraphSlam(sequence.a_graph if anchored else None, config=config)
            result = run_through(slam, ScanFolder(sequence.scan_dir))
            if anchored and not result.anchored:
                raise UserError(f"'{sequence.name}' seed {sequence.seed}: the first run could not be anchored")
            result.trajectory.write_tum(folder / "trajectory.tum")
            result.clouds.copy_to(folder / CLOUDS)
            Checkpoints(folder, {}).write(slam, {}, finished=True)
    return folder, Trajectory.read_tum(folder / "trajectory.tum")


@dataclass(frozen=True, eq=False)
class MapState:
    """A run at one scan: its stamp, the metres driven, the true positions (N, 3) up to it in the BIM frame, the
    S-graph, and the true pose `T_bim_map` (4, 4) of the map."""

    stamp_ns: int
    metres: float
    places: Array
    s_graph: SceneGraph
    T_bim_map: Array


class RunMonitor:
    """Follows a second run. `relocalised` is its state at the final relocalisation, None before; `wrong` counts the
    scans with a wrong pose."""

    def __init__(self, slam: SceneGraphSlam, truth: Trajectory, T_bim_known: Array) -> None:
        """`truth` is T_bim_sensor, `T_bim_known` (4, 4) the pose of the first run's map."""
        self._slam, self._truth, self._T_known_bim = slam, truth, inverse(T_bim_known)
        self.scans = self.wrong = 0
        self.driven, self.stamp_ns, self.began_ns = 0.0, 0, 0
        self.T_bim_map = np.eye(4)
        self.places: list[Array] = []
        self.relocalised: MapState | None = None

    def add(self, stamp_ns: int, T_map_sensor: Array) -> None:
        """Adds a scan with the pose (4, 4) that the run estimates for it."""
        true = self._truth.poses[int(np.abs(self._truth.stamps_ns - stamp_ns).argmin())]
        self.began_ns = self.began_ns if self.scans else stamp_ns
        self.scans, self.stamp_ns = self.scans + 1, stamp_ns
        self.driven += float(np.linalg.norm(true[:3, 3] - self.places[-1])) if self.places else 0.0
        self.T_bim_map = true @ inverse(T_map_sensor)
        self.places.append(true[:3, 3])
        T_prior_map = self._slam.T_prior_map
        if T_prior_map is None:
            self.relocalised = None
            return
        if self.relocalised is None:
            self.relocalised = self.state(self._slam.s_graph())
        off = inverse(self._T_known_bim @ true) @ T_prior_map @ T_map_sensor
        turned = abs(np.arctan2(off[1, 0], off[0, 0]))
        self.wrong += bool(np.linalg.norm(off[:3, 3]) > WRONG[0] or turned > WRONG[1])

    def state(self, s_graph: SceneGraph) -> MapState:
        """The state at the newest scan, with the S-graph of that scan."""
        return MapState(self.stamp_ns, self.driven, np.array(self.places), s_graph, self.T_bim_map)
