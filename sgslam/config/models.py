"""Every setting of a run, with its reason; pydantic checks types and bounds."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from sgslam.config.loop_settings import LoopSettings


class _Settings(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class OdometrySettings(_Settings):
    """KISS-ICP or small_gicp, set for indoors."""

    method: Literal["kiss", "small_gicp"] = Field("kiss", description="what finds the step from scan to scan")
    voxel_size: float = Field(1.0, gt=0, description="m; smaller is more exact and slower")
    max_range: float = Field(60.0, gt=0, description="m; points further off are left out of the odometry")
    min_range: float = Field(0.3, ge=0, description="m; points closer are left out of the odometry")
    iterations: int = Field(100, ge=1, description="of the registration at most")
    convergence: float = Field(3e-3, gt=0, description="m and rad at which the registration stops")
    max_step: float = Field(1.5, gt=0, description="m from scan to scan; a longer step is searched anew")
    max_turn: float = Field(0.8, gt=0, description="rad from scan to scan, likewise")
    max_tip: float = Field(0.25, gt=0, description="rad by which the vertical tips from scan to scan, likewise")
    min_share: float = Field(0.4, ge=0, le=1, description="of a scan that a search must explain")
    gicp_voxel_size: float = Field(0.25, gt=0, description="m, of small_gicp's scans and of its local map")
    gicp_spacing: float = Field(0.3, gt=0, description="m or rad between the scans of its local map")
    gicp_scans: int = Field(15, ge=1, description="in its local map at most")
    outlier_distance: float = Field(0.4, gt=0, description="m between two consecutive steps of an external odometry; a "
                                    "step that differs by more from the one before it is ignored")  # fmt: skip
    outlier_angle: float = Field(0.5, gt=0, description="rad between two consecutive steps of an external odometry; a "
                                 "step that differs by more from the one before it is ignored")  # fmt: skip
    unconstrained_speed_error: float = Field(1.0, gt=0, description="m/s by which the project's own odometry may be "
                                             "wrong where surfaces do not constrain it")  # fmt: skip
    unconstrained_turn_error: float = Field(0.3, gt=0, description="rad/s by which the project's own odometry may be "
                                            "wrong where surfaces do not constrain it")  # fmt: skip
    external_speed_error: float = Field(0.02, gt=0, description="m/s by which an external odometry may be wrong where "
                                        "surfaces do not constrain it")  # fmt: skip
    external_turn_error: float = Field(0.01, gt=0, description="rad/s by which an external odometry may be wrong where "
                                       "surfaces do not constrain it")  # fmt: skip
    sigma_rotation: float = Field(0.004, gt=0, description="rad, a step between keyframes")
    sigma_translation: float = Field(0.015, gt=0, description="m, a step between keyframes")


class TrackingSettings(_Settings):
    """Each scan against the walls known so far."""

    correct: bool = Field(True, description="correct each scan; false where the odometry is to be trusted")
    points: int = Field(100, ge=20, description="of the floor that are used, and twice as many of walls")
    every_column: int = Field(4, ge=1, description="of a scan that is used, for odometry too")
    reach: float = Field(20.0, gt=0, description="m to the walls that are used")
    gates: tuple[float, ...] = Field((0.4, 0.12), description="m from a wall, one for each step")
    sure_step: float = Field(0.01, gt=0, description="m and rad; after a shorter one of all points no other is made")
    sigma_point: float = Field(0.05, gt=0, description="m; neighbouring points share their errors")
    huber: float = Field(0.03, gt=0, description="m from a wall beyond which a point pulls less")
    sigma_height: float = Field(0.03, gt=0, description="m by which the sensor's height above the floor changes")
    sigma_tilt: float = Field(0.02, gt=0, description="rad by which the sensor leans to and fro as it is carried")
    tilt_memory: float = Field(0.05, gt=0, le=1, description="share by which its mean tilt follows each scan")
    sigma_translation: float = Field(0.05, gt=0, description="m, of the odometry's word for one scan")
    sigma_rotation: float = Field(0.02, gt=0, description="rad, likewise")
    firm_share: float = Field(0.5, ge=0, le=1, description="of a scan's points that must lie on walls, and")
    firm_points: float = Field(20.0, gt=0, description="on walls across each direction, else the odometry is asked")
    surprise_distance: float = Field(0.15, gt=0, description="m from where the last step leads; beyond, likewise")
    surprise_angle: float = Field(0.1, gt=0, description="rad, likewise")


class KeyframeSettings(_Settings):
    """A keyframe is taken when any of these is reached, and at the last scan."""

    distance: float = Field(0.8, gt=0, description="m from the last keyframe")
    angle: float = Field(0.6, gt=0, description="rad by which the sensor has turned since")
    scans: int = Field(15, ge=1, description="scans while moving: odometry that slips shows no distance")
    standing: int = Field(50, ge=1, description="scans while standing still, then twice as many, ...")


class SurfaceSettings(_Settings):
    """Wall surfaces seen in one scan, and their association across keyframes."""

    columns: int = Field(900, ge=90, description="of the virtual 2D scan")
    high_band: tuple[float, float] = Field((0.9, 2.55), description="m above the floor: over furniture, under ceilings")
    low_band: tuple[float, float] = Field((0.12, 0.88), description="m above the floor: parapets")
    guessed_height: float = Field(1.0, gt=0, description="m of the sensor above the floor until the floor is seen")
    split: float = Field(0.06, gt=0, description="m from the chord at which a chain of points is split")
    min_columns: int = Field(5, ge=3, description="of the virtual scan that a piece of wall must fill")
    min_length: float = Field(0.35, gt=0, description="m of a piece of wall")
    merge_gap: float = Field(0.5, ge=0, description="m between collinear pieces of one scan")
    max_tilt: float = Field(0.09, gt=0, description="rad from the vertical")
    associate_angle: float = Field(0.14, gt=0, description="rad to a known wall, to be taken for it")
    associate_offset: float = Field(0.12, gt=0, description="m across, likewise")
    associate_gap: float = Field(1.0, ge=0, description="m along, likewise")
    join_angle: float = Field(0.1, gt=0, description="rad between two walls that turn out to be one")
    join_offset: float = Field(0.1, gt=0, description="m across, likewise")
    split_step: float = Field(0.05, gt=0, description="m across at which a wall is parted in two, end to end")
    min_observations: int = Field(3, ge=1, description="keyframes that must have seen a surface")


class RoomSettings(_Settings):
    """Rooms from free space: walls and lintels are barriers, doors are necks."""

    cell: float = Field(0.05, gt=0, description="m, of the grid of free space")
    seed_clearance: float = Field(0.62, gt=0, description="m to the next barrier where a room may begin")
    neck: float = Field(1.35, gt=0, description="m; wider openings do not part rooms")
    min_area: float = Field(1.5, gt=0, description="m2; what is smaller is no room")
    lintel_band: tuple[float, float] = Field((2.05, 2.6), description="m above the floor")


class CloudSettings(_Settings):
    """The keyframes' points, kept on the disk for the point cloud map and for whoever compares keyframes."""

    keyframe_voxel: float = Field(0.1, gt=0, description="m; of a keyframe's points one is kept in each voxel")
    map_voxel: float = Field(0.05, gt=0, description="m, of the point cloud map")


class BackendSettings(_Settings):
    """Noise of the factors and the schedule of the optimisation."""

    scene_keyframes: int = Field(16, ge=1, description="keyframes between two cuts into rooms, at the least")
    unplaced_keyframes: int = Field(3, ge=1, description="likewise, while the place in the plan is not known")
    scene_growth: float = Field(0.25, ge=0, description="and this share of all keyframes")
    every_keyframes: int = Field(12, ge=1, description="keyframes between two optimisations, at the least")
    growth: float = Field(0.08, ge=0, description="and this share of all keyframes")
    sigma_normal: float = Field(0.004, gt=0, description="rad, floor of a wall observation's normal")
    sigma_offset: float = Field(0.008, gt=0, description="m, floor of a wall observation's offset")
    sigma_floor_offset: float = Field(0.01, gt=0, description="m, of the floor as a keyframe sees it")
    sigma_floor_normal: float = Field(0.006, gt=0, description="rad, likewise")
    huber: float = Field(1.345, gt=0, description="of whitened residuals")


class AnchorSettings(_Settings):
    """Anchors to the BIM: how well the building keeps to its plan."""

    planes: bool = Field(True, description="anchor matched walls")
    rooms: bool = Field(True, description="anchor matched rooms")
    sigma_offset: float = Field(0.006, gt=0, description="m, a wall's offset as built")
    sigma_normal: float = Field(0.004, gt=0, description="rad, a wall's normal as built")
    sigma_extraction: float = Field(0.004, gt=0, description="m, what all observations of a wall may have in common")
    tolerance: float = Field(0.03, gt=0, description="m; a wall that is less off the plan stands as planned")
    doubtful: float = Field(0.08, gt=0, description="m; off by less, the map may be off; it still pulls")
    sigma_room: float = Field(0.03, gt=0, description="m, a room's place as built")
    sigma_loose: float = Field(0.2, gt=0, description="m and rad, a wall that stands otherwise than planned")
    reach: float = Field(0.4, gt=0, description="m; a wall further off is not the planned one")
    gate_angle: float = Field(0.07, gt=0, description="rad, likewise")
    gate_offset: float = Field(0.15, gt=0, description="m by which the back end may be off the walls' consensus")
    redescending: float = Field(3.0, gt=0, description="whitened residual at which an anchor's pull is a quarter")
    least_agreeing: float = Field(0.3, gt=0, le=1, description="of a match's walls that must agree on its place")
    least_share: float = Field(0.5, gt=0, le=1, description="of the walls as planned; below, the matcher is asked")
    sigma_floor: float = Field(0.01, gt=0, description="m, a storey's elevation as built")


class MatchingSettings(_Settings):
    """When and how the S-graph is matched."""

    method: str = Field("learned", description="the matcher's name, such as learned or voting")


class Config(_Settings):
    """All settings of a run."""

    odometry: OdometrySettings = OdometrySettings()
    tracking: TrackingSettings = TrackingSettings()
    keyframes: KeyframeSettings = KeyframeSettings()
    surfaces: SurfaceSettings = SurfaceSettings()
    rooms: RoomSettings = RoomSettings()
    clouds: CloudSettings = CloudSettings()
    backend: BackendSettings = BackendSettings()
    anchors: AnchorSettings = AnchorSettings()
    matching: MatchingSettings = MatchingSettings()
    loops: LoopSettings = LoopSettings()
