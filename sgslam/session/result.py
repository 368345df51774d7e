"""What a run gives: trajectories of all scans, the S-graph, the matches, deviations, metrics; and its folder."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from data import SceneGraph
from data.geometry.poses import poses_to_xyzquat
from data.trajectory import Trajectory
from sgslam.anchoring.anchor_log import AnchorEntry
from sgslam.anchoring.building_anchoring import BuildingAnchoring
from sgslam.anchoring.wall_alignment import Holding
from sgslam.as_built.deviation_entries import Deviation
from sgslam.as_built.deviation_list import deviations
from sgslam.as_built.deviations import measured_pieces
from sgslam.backend.backend import Backend
from sgslam.backend.covariances import Uncertainty
from sgslam.backend.factor_log import FactorLog
from sgslam.config import Config
from sgslam.geometry.frames import inverse
from sgslam.mapping.floors import Floors
from sgslam.mapping.keyframe_clouds import KeyframeClouds
from sgslam.session.run_output import prepare_folder, save_result

if TYPE_CHECKING:
    from matching.result import MatchesFile  # loads the matchers

Floats = NDArray[np.float64]
_COVARIANCES = 50  # poses whose covariance is worked out


@dataclass
class ScanPose:
    """Where one scan was thought to be when it came; `keyframe` is the last keyframe at or before it. All poses are of
    the instant that the scan was deskewed to, `offset_ns` after its stamp."""

    stamp_ns: int
    T_odom_sensor: Floats
    T_map_sensor: Floats
    keyframe: int
    T_keyframe_sensor: Floats  # since that keyframe
    T_previous_sensor: Floats | None = None  # of a keyframe: since the keyframe before it
    offset_ns: int = 0


@dataclass(frozen=True)
class Returned:
    """Whether a run was found in the map of earlier ones, so many seconds after its start, and why."""

    found: bool
    found_s: float | None
    reason: str


@dataclass(frozen=True)
class Update:
    """What is known right after a scan.

    `T_map_sensor` (4, 4) is the sensor's pose in the map frame (metres) at `stamp_ns` (nanoseconds). It is not smoothed
    yet: the poses of a finished run are in `Result`. `keyframes` is how many there are so far, `anchored` whether the
    map has its place in the plan.
    """

    stamp_ns: int
    T_map_sensor: Floats
    keyframes: int
    anchored: bool


@dataclass(frozen=True, eq=False)
class PoseCovariances:
    """`trajectory`: some keyframes, evenly over the run, T_bim_sensor; `covariances` (N, 6, 6) of their poses, rotation
    first (rad), then translation (m), in the sensor's axes."""

    trajectory: Trajectory
    covariances: Floats


@dataclass(frozen=True)
class Result:
    """A finished run, in metres, radians and seconds.

    `anchored` says whether the map has its place in the plan, `reason` why or why not, in one line. `trajectory` is in
    the BIM frame when `anchored`, else in the map frame, as `trajectory_map` always is; `trajectory_odometry` is the
    odometry alone, in its own frame. `T_bim_map` (4, 4) is the map's pose in the BIM frame, None where the run is not
    anchored. `s_graph` is in the map frame, `a_graph` in the BIM frame, None where no plan was given. `matches` has the
    form of matches.json, None where nothing was matched; `deviations` has that of deviations.json, empty where the run
    is not anchored. `first_anchor_s` is counted from the first scan. `seconds` is the time that each stage took.
    """

    anchored: bool
    reason: str
    trajectory: Trajectory
    trajectory_map: Trajectory
    trajectory_odometry: Trajectory
    T_bim_map: Floats | None
    s_graph: SceneGraph
    a_graph: SceneGraph | None
    matches: "MatchesFile | None"
    deviations: list[Deviation]
    anchors: list[AnchorEntry]  # the log: each with who added it, and what became of it when and why
    factors: FactorLog  # of the back end: all that hold, and what was added and withdrawn by whom and why
    pose_covariances: PoseCovariances | None  # where the run was anchored
    first_anchor_s: float | None
    keyframes: int
    seconds: dict[str, float]
    config: Config
    clouds: KeyframeClouds  # by the number of the keyframe, `k<number>` in the S-graph
    earlier: tuple[Trajectory, ...] = ()  # of the runs that the map was joined to, in the frame of `trajectory`
    returned: Returned | None = None  # where there was a known map

    def save(self, out: Path | str) -> None:
        """Writes the run's folder: trajectories, graphs, matches, deviations, metrics, configuration, report."""
        save_result(self, prepare_folder(Path(out)))

    def metrics(self) -> dict[str, Any]:
        """The form of metrics.json, without what only the command knows."""
        T = self.T_bim_map
        return {
            "anchored": self.anchored,
            "reason": self.reason,
            "T_bim_map": None if T is None else poses_to_xyzquat(T[None])[0].tolist(),
            "scans": len(self.trajectory),
            "scans_skipped": 0,
            "keyframes": self.keyframes,
            "rooms": len(self.s_graph.rooms),
            "wall_surfaces": len(self.s_graph.wall_surfaces),
            "first_anchor_s": self.first_anchor_s,
            "seconds": self.seconds,
            "runs": len(self.earlier) + 1,
            "returned": None if self.returned is None else asdict(self.returned),
        }


def finished(
    scans: list[ScanPose], backend: Backend, floors: Floors, bim: SceneGraph | None,
    anchoring: BuildingAnchoring | None, first_anchor_ns: int | None, seconds: dict[str, float], config: Config,
    clouds: KeyframeClouds, begins: list[int], returned: Returned | None,
    lost: list[tuple[list[ScanPose], Floats]],
) -> Result:  # fmt: skip
    """Puts a run's result together; `begins` are the places in the scans at which runs begin, this one the last;
    `lost` the scans and the keyframes' poses of what could not be placed: it is taken to begin where the sensor was
    seen last."""
    runs = [slice(a, b) for a, b in zip(begins, [*begins[1:], len(scans)], strict=True)]
    poses, newest = smooth(scans, backend.poses), runs[-1]
    *earlier, trajectory_map = [_at_stamps(scans[run], poses[run]) for run in runs]
    known, trajectory_map = trajectory_map, _with_lost(trajectory_map, lost)
    of_run = sorted([*scans[newest], *(s for part, _ in lost for s in part)], key=lambda s: s.stamp_ns)
    odometry = _at_stamps(of_run, np.stack([s.T_odom_sensor for s in of_run]))
    anchored = anchoring is not None and backend.T_map_bim is not None
    T_bim_map = anchoring.bim_from_map(backend.T_map_bim) if anchored else None  # type: ignore[union-attr, arg-type]
    holdings = anchoring.holdings(floors, backend.T_map_bim) if anchoring is not None else {}
    matches = anchoring.answer(floors, holdings) if anchoring is not None else None
    s_graph = floors.graph(backend.keyframes, [floor.scene for floor in floors.maps if floor.scene is not None])
    uncertainty = backend.uncertainty() if T_bim_map is not None else None
    return Result(
        anchored, "no BIM was given" if anchoring is None else anchoring.reason,
        trajectory_map if T_bim_map is None else trajectory_map.transformed(T_bim_map),
        trajectory_map, odometry, T_bim_map, s_graph, bim, cast("MatchesFile | None", matches),
        _deviations(anchoring, holdings, floors, backend, uncertainty, config),
        [record.to_dict() for record in anchoring.records] if anchoring is not None else [],
        backend.log, _covariances(backend, uncertainty, T_bim_map, known, newest.start),
        (first_anchor_ns - scans[newest.start].stamp_ns) / 1e9 if anchored and first_anchor_ns is not None else None,
        len(backend.keyframes), dict(seconds), config, clouds,
        tuple(run if T_bim_map is None else run.transformed(T_bim_map) for run in earlier), returned,
    )  # fmt: skip


def _deviations(
    anchoring: BuildingAnchoring | None, holdings: dict[int, Holding], floors: Floors, backend: Backend,
    uncertainty: Uncertainty | None, config: Config,
) -> list[Deviation]:  # fmt: skip
    """The form of deviations.json, storey after storey; empty where the run was not anchored."""
    found: list[Deviation] = []
    if anchoring is None or uncertainty is None:
        return found
    for floor in floors.maps:
        holding, scene, own = holdings.get(floor.number), floor.scene, anchoring.of(floor.number)
        if holding is None or scene is None:
            continue
        pieces = measured_pieces(holding, scene, floor.walls, uncertainty, anchoring.origin, own.height, config)
        keyframes = [k for k in backend.keyframes if k.storey == floor.number]
        found += deviations(
            pieces, holding, scene, floor.walls, keyframes, own.storey, anchoring.origin[:2], config
        )  # fmt: skip
    return found


def _covariances(
    backend: Backend, uncertainty: Uncertainty | None, T_bim_map: Floats | None, in_map: Trajectory, begin: int
) -> PoseCovariances | None:
    if uncertainty is None or T_bim_map is None:
        return None
    own = [i for i, keyframe in enumerate(backend.keyframes) if keyframe.scan >= begin]
    places = np.unique(np.linspace(0, len(own) - 1, min(len(own), _COVARIANCES)).astype(int))
    chosen = np.array(own)[places]
    scans = np.searchsorted(in_map.stamps_ns, [backend.keyframes[i].stamp_ns for i in chosen])
    covariances = uncertainty.pose_covariances(chosen.tolist())
    order = np.argsort(scans)
    return PoseCovariances(
        Trajectory(in_map.stamps_ns[scans[order]], T_bim_map @ in_map.poses[scans[order]]), covariances[order]
    )


def _with_lost(known: Trajectory, lost: list[tuple[list[ScanPose], Floats]]) -> Trajectory:
    """With the poses of scans that nobody could place, each part from where the sensor was seen last before it."""
    stamps, poses = [known.stamps_ns], [known.poses]
    for scans, keyframes in lost:
        part = _at_stamps(scans, smooth(scans, keyframes))
        before = max(int(np.searchsorted(known.stamps_ns, part.stamps_ns[0])) - 1, 0)
        stamps.append(part.stamps_ns)
        poses.append(known.poses[before] @ inverse(part.poses[0]) @ part.poses)
    order = np.argsort(np.concatenate(stamps), kind="stable")
    return Trajectory(np.concatenate(stamps)[order], np.concatenate(poses)[order])


def _at_stamps(scans: list[ScanPose], poses: Floats) -> Trajectory:
    """The trajectory at the scans' stamps, of poses (N, 4, 4) at the instants that they were deskewed to; a part of a
    run that was found late stands behind later ones."""
    order = np.argsort([s.stamp_ns for s in scans], kind="stable")
    scans, poses = [scans[i] for i in order], poses[order]
    stamps = np.array([s.stamp_ns for s in scans], dtype=np.int64)
    offsets = np.array([s.offset_ns for s in scans], dtype=np.int64)
    if not offsets.any():
        return Trajectory(stamps, poses)
    return Trajectory(stamps, Trajectory(stamps + offsets, poses).at(stamps))


def smooth(scans: list[ScanPose], keyframe_poses: Floats) -> Floats:
    """(N, 4, 4) T_map_sensor of all scans: each keeps its motion since the keyframe before it, and what is then left
    at the next keyframe is shared out over the scans between, in proportion."""
    keyframe_of = np.array([scan.keyframe for scan in scans])
    poses = keyframe_poses[keyframe_of] @ np.stack([scan.T_keyframe_sensor for scan in scans])
    keyframes, first = np.unique(keyframe_of, return_index=True)
    left, share = np.tile(np.eye(4), (len(scans), 1, 1)), np.zeros((len(scans), 1))
    for keyframe, following, start, end in zip(keyframes, keyframes[1:], first, first[1:], strict=False):
        arrived = scans[end].T_previous_sensor
        if following == keyframe + 1 and arrived is not None:  # else nothing leads there: another run begins
            left[start:end] = inverse(keyframe_poses[keyframe] @ arrived) @ keyframe_poses[following]
            share[start:end, 0] = np.arange(end - start) / (end - start)
    turn = Rotation.from_rotvec(share * Rotation.from_matrix(left[:, :3, :3]).as_rotvec()).as_matrix()
    poses[:, :3, 3] += np.einsum("nij,nj->ni", poses[:, :3, :3], share * left[:, :3, 3])
    poses[:, :3, :3] = poses[:, :3, :3] @ turn
    return poses
