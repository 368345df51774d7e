"""The configuration: all settings of a run but those of tracking."""

from typing import Literal

from pydantic import Field

from matching.matcher import DEFAULT
from sgslam.config.tracking_settings import FloorSettings, Settings, TrackingSettings


class ImuSettings(Settings):
    """Pose of an IMU on the LiDAR, and its errors; only used if IMU samples are given."""

    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """degrees, roll, pitch and yaw of the IMU in the LiDAR's axes, turned about x, then y, then z"""
    translation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """m, position of the IMU in the LiDAR's axes; an error of a few centimetres does no harm"""
    gyro_noise: float = Field(5e-3, gt=0)
    """rad/s/sqrt(Hz), noise density of the gyroscope; far above a chip's, to cover errors of its scale and of
    `rotation`: a hundredth of a quick turn"""
    gyro_bias: float = Field(0.02, gt=0)
    """rad/s, standard deviation of the gyroscope's bias at the beginning; data sheets say 0.01 to 0.02"""
    accel_error: float = Field(0.5, gt=0)
    """m/s2, standard deviation of the mean acceleration between two knots, bias excluded: a tilt of 1 degree adds 0.17,
    a `translation` that is off by 5 cm adds 0.5 in a quick hand"""
    accel_bias: float = Field(0.2, gt=0)
    """m/s2, standard deviation of the accelerometer's bias at the beginning; data sheets say 0.1 to 0.4"""


class LoopSettings(Settings):
    """When loop closures are searched for."""

    enabled: bool = True
    """close loops where the map is not anchored or the odometry may have slipped"""
    gap: float = Field(15.0, gt=0)
    """m, minimum path length between two passes of a place"""
    drift: float = Field(0.03, gt=0)
    """maximum drift between two passes, in metres per metre of path between them"""
    most_drift: float = Field(4.0, gt=0)
    """m, upper limit of the drift within which a place is searched for"""


class QualitySettings(Settings):
    """Limits of the signals that tell a sound map from one that was lost."""

    map_against_odometry: float = Field(0.01, gt=0)
    """maximum difference between the trajectories of map and odometry, as a share of the path length; 0.001 in sound
    maps, 0.02 in lost ones"""
    lost_scans: float = Field(0.05, ge=0, le=1)
    """maximum share of scans that are lost"""
    unplaced_scans: float = Field(0.05, ge=0, le=1)
    """maximum share of scans in submaps that were not placed, whose poses are in separate frames"""
    keyframes_without_walls: float = Field(0.3, ge=0, le=1)
    """maximum share of keyframes that see no wall; 0.02 in sound maps, 0.6 to 0.9 in lost ones"""
    walls_per_keyframe: float = Field(3.0, ge=0)
    """minimum mean number of walls that a keyframe sees; 5 to 13 in sound maps, 0.3 to 2 in lost ones"""
    anchored_position: float = Field(0.5, gt=0)
    """m, maximum position error of an anchored scan along each axis; enough to tell the room"""
    anchored_attitude: float = Field(5.0, gt=0)
    """degrees, maximum attitude error of an anchored scan about each axis"""
    anchored_probability: float = Field(0.99, gt=0, lt=1)
    """minimum probability that all errors of an anchored scan are within these limits, a conformance probability as
    JCGM 106:2012 defines it; of scans at the minimum, one in a hundred is off by more"""
    position_sigma: float = Field(0.2, gt=0)
    """m, maximum of the 95 % quantile of the positions' standard deviations"""
    place_probability: float = Field(0.9, gt=0, lt=1)
    """minimum probability that the map is sound and at its place in the plan"""


class OdometrySettings(Settings):
    """The odometry: our own in continuous time (see tracking), KISS-ICP or small_gicp; the defaults are for indoor
    scans."""

    method: Literal["continuous_time", "kiss", "small_gicp"] = "continuous_time"
    """odometry method"""
    voxel_size: float = Field(0.3, gt=0)
    """m, voxel size of KISS-ICP's scans and local map; smaller is slower"""
    outlier_speed: float = Field(5.0, gt=0)
    """m/s, and rad/s of a turn: change of the velocity of given poses beyond which a step is an outlier; a sensor is
    carried more slowly"""
    given: Literal["exact", "measured"] = "exact"
    """how given poses, of other odometries too, are used: `exact` ones replace registration; of `measured` ones, the
    motion from scan to scan enters our own registration with the errors below, and predicts the pose of a lost
    sensor"""
    given_sigma_rotation: float = Field(0.02, gt=0)
    """rad, standard deviation of each angle of a measured step from scan to scan; handheld, the errors of RKO-LIO and
    KISS-SLAM were 0.006 to 0.08"""
    given_sigma_translation: float = Field(0.05, gt=0)
    """m, standard deviation of each coordinate of a measured step; handheld, the errors of both were 0.03 to 0.12"""
    sigma_rotation: float = Field(0.002, gt=0)
    """rad, standard deviation of the rotation between two keyframes, for our own odometry, map errors included"""
    sigma_translation: float = Field(0.004, gt=0)
    """m, standard deviation of the translation between two keyframes, for our own odometry"""
    other_sigma_rotation: float = Field(0.004, gt=0)
    """rad, standard deviation of the rotation between two keyframes, for all odometries but our own"""
    other_sigma_translation: float = Field(0.015, gt=0)
    """m, standard deviation of the translation between two keyframes, for all odometries but our own"""


class KeyframeSettings(Settings):
    """When a keyframe is added: at the first limit that is reached, and at the last scan."""

    distance: float = Field(0.8, gt=0)
    """m, distance from the last keyframe"""
    angle: float = Field(0.6, gt=0)
    """rad, rotation since the last keyframe"""
    scans: int = Field(15, ge=1)
    """number of scans since the last keyframe while moving, even without odometric motion"""


class SurfaceSettings(Settings):
    """Wall surfaces extracted from single scans, and their association across keyframes."""

    columns: int = Field(900, ge=90)
    """number of columns of the virtual 2D scan"""
    high_band: tuple[float, float] = (0.9, 2.55)
    """m, heights above the floor in which walls are detected, over furniture and under ceilings"""
    low_band: tuple[float, float] = (0.12, 0.88)
    """m, heights above the floor in which parapets are seen"""
    guessed_height: float = Field(1.0, gt=0)
    """m, assumed height of the sensor above the floor until the floor is detected"""
    split: float = Field(0.06, gt=0)
    """m, distance from the chord at which a chain of points is split, and of a wall's points from its plane"""
    min_length: float = Field(0.35, gt=0)
    """m, minimum length of a wall segment"""
    associate_angle: float = Field(0.14, gt=0)
    """rad, maximum angle between a segment and its associated wall"""
    associate_offset: float = Field(0.12, gt=0)
    """m, maximum distance between a segment and its associated wall, perpendicular to the wall"""
    min_observations: int = Field(3, ge=1)
    """minimum number of keyframes that must observe a surface"""


class LevelSettings(Settings):
    """Level surfaces (floors, ceilings) seen in the scans of a keyframe, and their association across keyframes."""

    step: float = Field(0.12, gt=0)
    """m, minimum height between two floors; less than a stair's riser"""
    ceiling_step: float = Field(0.04, gt=0)
    """m, minimum height between two ceilings seen close together; beams and ducts hang some decimetres lower"""


class RoomSettings(Settings):
    """Room segmentation from free space: walls and lintels are barriers, doors are necks."""

    seed_clearance: float = Field(0.62, gt=0)
    """m, minimum distance from the seed of a room to the nearest barrier"""
    neck: float = Field(1.35, gt=0)
    """m, widest opening that separates two rooms"""
    min_area: float = Field(1.5, gt=0)
    """m2, minimum area of a room"""
    lintel_band: tuple[float, float] = (2.05, 2.6)
    """m, heights above the floor in which door lintels are seen"""


class CloudSettings(Settings):
    """The keyframes' points, stored on disk for the point cloud map and for comparing keyframes."""

    keyframe_voxel: float = Field(0.1, gt=0)
    """m, spacing of a keyframe's stored points: one per angular cell, whose width is this spacing at the point"""
    map_voxel: float = Field(0.05, gt=0)
    """m, voxel size of the point cloud map"""


class BackendSettings(Settings):
    """Noise of the factors and schedule of the optimisation."""

    every_keyframes: int = Field(12, ge=1)
    """minimum number of keyframes between two optimisations"""
    growth: float = Field(0.08, ge=0)
    """minimum growth of the map between two optimisations, as a share of all keyframes"""
    sigma_wall: float = Field(0.008, gt=0)
    """m, standard deviation of the error that the points of an observed wall share: of its offset, and of the ends of a
    short piece, whose normal is uncertain"""
    sigma_floor_offset: float = Field(0.01, gt=0)
    """m, standard deviation of the floor's offset in a keyframe"""
    sigma_floor_normal: float = Field(0.006, gt=0)
    """rad, standard deviation of the floor's normal in a keyframe"""


class AnchorSettings(Settings):
    """Anchors to the BIM: how sure its place is, and how closely the building agrees with its plan."""

    commit: float = Field(0.99, gt=0.5, lt=1)
    """minimum probability of the map's place in the plan to be anchored there"""
    withdraw: float = Field(0.5, ge=0, lt=1)
    """probability that the map is sound and at its place, below which its anchors are withdrawn; 0 keeps them"""
    planes: bool = True
    """anchor matched walls"""
    rooms: bool = True
    """anchor matched rooms"""
    points: bool = True
    """adjust the finished map to the plan by all points that its keyframes saw on walls"""
    sigma_offset: float = Field(0.012, gt=0)
    """m, standard deviation of a wall's offset as built; DIN 18202 allows at most 12 to 24 mm over 3 to 15 m"""
    sigma_normal: float = Field(0.004, gt=0)
    """rad, standard deviation of a wall's normal as built"""
    sigma_extraction: float = Field(0.004, gt=0)
    """m, standard deviation of the error that all observations of a wall share"""
    sigma_room: float = Field(0.03, gt=0)
    """m, standard deviation of a room's position as built"""
    reach: float = Field(0.4, gt=0)
    """m, maximum distance between a wall and its planned wall"""
    sigma_floor: float = Field(0.01, gt=0)
    """m, standard deviation of a floor's height as built"""
    sigma_ceiling: float = Field(0.03, gt=0)
    """m, standard deviation of the ceilings' height as built, above the floor: plans are 1 to 3 cm off"""


class AsBuiltSettings(Settings):
    """The comparison of the building as built with its plan."""

    tolerance: float = Field(0.03, ge=0.001, le=0.2)
    """m, maximum offset of an element that counts as planned (option --tolerance)"""
    cloud_reach: float = Field(0.3, gt=0, le=5)
    """m, maximum distance between a point of the map and the planned face to which it is compared; points farther away
    are furniture or not planned"""


class MatchingSettings(Settings):
    """How the S-graph is matched with the plan."""

    method: str = DEFAULT
    """name of the matcher: voting, or learned, where a network judges how probable each place is"""


class Config(Settings):
    """All settings of a run."""

    odometry: OdometrySettings = OdometrySettings()
    tracking: TrackingSettings = TrackingSettings()
    imu: ImuSettings = ImuSettings()
    floors: FloorSettings = FloorSettings()
    keyframes: KeyframeSettings = KeyframeSettings()
    surfaces: SurfaceSettings = SurfaceSettings()
    levels: LevelSettings = LevelSettings()
    rooms: RoomSettings = RoomSettings()
    clouds: CloudSettings = CloudSettings()
    backend: BackendSettings = BackendSettings()
    anchors: AnchorSettings = AnchorSettings()
    matching: MatchingSettings = MatchingSettings()
    loops: LoopSettings = LoopSettings()
    quality: QualitySettings = QualitySettings()
    as_built: AsBuiltSettings = AsBuiltSettings()
