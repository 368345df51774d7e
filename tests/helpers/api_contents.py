"""What the pages of docs/api document, page by page: a name is documented where it stands in `PAGES`."""

from dataclasses import dataclass

CONVENTIONS = """Lengths are in metres, angles in radians, stamps in integer nanoseconds. `T_a_b` (4, 4) maps
coordinates in frame b to frame a. The BIM frame is the building's, the map frame the run's own. A mistake of the user
raises `UserError` with a message of one line.

Names imported from `sgslam`, `matching` and `factors` are public in the sense of the [changelog](../changelog.md);
modules below these packages may move."""


@dataclass(frozen=True)
class Page:
    """`groups` are the headings and the paths of the names below them, separated by spaces."""

    title: str
    about: str
    groups: dict[str, str]


PAGES = {
    "slam": Page(
        "Running SLAM",
        "Scans and a plan in, a trajectory in the building out. [Live use](../live.md) says when to use `LiveSlam`.",
        {
            "The run": "sgslam.SceneGraphSlam sgslam.Update",
            "Its result": "sgslam.Result sgslam.session.soundness.scan_uncertainty.ScanUncertainty "
            "sgslam.session.soundness.quality.Signal sgslam.session.PoseCovariances "
            "sgslam.session.result.Relocalisation",
            "Deviations from the plan": "sgslam.as_built.deviation_entries.MovedDeviation "
            "sgslam.as_built.deviation_entries.AbsentDeviation sgslam.as_built.deviation_entries.ExtraDeviation",
            "Anchors": "sgslam.anchoring.AnchorRecord sgslam.anchoring.anchor_log.AnchorEvent "
            "sgslam.anchoring.AnchorEntry",
            "Settings and errors": "sgslam.Config sgslam.config.loading.load_config sgslam.UserError",
            "Live": "sgslam.LiveSlam sgslam.live.Answer sgslam.live.HeldAnchor",
            "Odometry": "sgslam.odometry.Odometry sgslam.registration.Registration sgslam.KissOdometry",
        },
    ),
    "data": Page(
        "Plans, scans and trajectories",
        "What goes in and what comes out, as plain types. [Formats](../formats.md) says which files can be read.",
        {
            "Plans": "sgslam.load_bim data.plans.Bim",
            "The scene graph": "sgslam.SceneGraph data.Floor data.Room data.WallSurface data.Door data.Keyframe "
            "data.scene_graph.implausible",
            "Scans": "data.scans.sources.open_scans data.scans.ScanFolder data.scans.ScanSource data.scans.Scan "
            "data.scans.scan.SkippedScan",
            "An IMU": "data.imu.read_imu data.imu.ImuSamples",
            "Trajectories": "data.trajectory.Trajectory",
            "Simulated drives": "data.generation.demo_building.write_demo_building data.simulation.simulate.simulate "
            "data.simulation.SimulatedRun data.simulation.run.VisitedRoom",
        },
    ),
    "matching": Page(
        "Matching",
        "Where a mapped scene graph (S-graph) is in a planned one (A-graph). "
        "[Factors](../factors.md#from-s-graph-to-anchors) shows the matcher in a pose graph of your own.",
        {
            "The matcher": "sgslam.Matcher matching.MatchResult matching.Hypothesis",
            "A matcher of your own": "matching.protocol.AnyMatcher matching.protocol.Match",
        },
    ),
    "factors": Page(
        "Factors",
        "GTSAM factors of numpy arrays. A plane is `(nx, ny, nz, d)` with `n.x + d = 0`. "
        "[Factors in your own graph](../factors.md) explains when to use which, with examples.",
        {
            "Observed planes": "factors.observe_plane factors.observe_own_plane factors.plane_from_wall",
            "Rooms": "factors.wall_of_room factors.fit_room",
            "The building": "factors.anchor_plane factors.storey_plane factors.anchor_room factors.frame_at "
            "factors.plane_from",
            "Anchors of a match": "factors.anchors_of factors.PlaneKeys factors.Anchors",
            "Noise": "factors.noise_of_plane factors.noise_of_pose factors.noise_of_covariance "
            "factors.redescending_noise_of_plane",
        },
    ),
}
MORE = {  # what no docstring can say
    "Config": """[Parameters](../parameters.md) lists the settings of each group with their bounds.

```python
from sgslam.config.loading import load_config

config = load_config(None, ["quality.lost_scans=0.1", "matching.method=voting"])
assert config.quality.lost_scans == 0.1
```""",
    "MovedDeviation": """In all three kinds, `s_id` is a surface of the S-graph, `a_id` one of the A-graph, `source`
the id of the planned wall in its file. `significant` is true if the difference exceeds the measurement error;
`reason` explains the decision.""",
    "ScanUncertainty": "[What a run's words mean](../trust.md#of-each-scan) says how reliable it is.",
    "Signal": "`Result.quality` holds these by name; [what a run's words mean](../trust.md#of-the-map) explains them.",
}
LEFT_OUT = (  # members for the other packages of this project
    "ImuSamples.digest", "KissOdometry.restore", "KissOdometry.state", "LiveSlam.of", "Matcher.__init__",
    "ScanUncertainty.joined", "ScanUncertainty.states", "SceneGraphSlam.add_tracked", "SceneGraphSlam.loops",
    "SceneGraphSlam.restore", "SceneGraphSlam.snapshot", "SceneGraphSlam.state",
)  # fmt: skip
