"""Settings of loop closure."""

from pydantic import BaseModel, ConfigDict, Field


class LoopSettings(BaseModel):
    """When places seen again are looked for, and what is asked of a closure before it is believed."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    enabled: bool = Field(True, description="close loops where the map is not anchored, or may have slipped")
    gap: float = Field(15.0, gt=0, description="m driven between two passes of a place")
    drift_base: float = Field(0.3, ge=0, description="m by which two passes may be apart, and")
    drift: float = Field(0.03, gt=0, description="m more for each metre driven between them")
    most_drift: float = Field(4.0, gt=0, description="m; beyond, no place is searched")
    turn_base: float = Field(0.03, ge=0, description="rad by which two passes may be turned, and")
    turn: float = Field(0.002, gt=0, description="rad more for each metre driven between them")
    most_turn: float = Field(0.3, gt=0, description="rad, at most")
    submap: float = Field(8.0, gt=0, description="m of way about a keyframe whose scans are put together")
    spacing: float = Field(2.0, gt=0, description="m of way between two places that are searched for")
    searches: int = Field(2, ge=1, description="at most, each time the graph is optimised")
    overlap: float = Field(0.5, gt=0, le=1, description="of what one pass saw that must lie in space the other knows")
    agreement: float = Field(0.8, gt=0, le=1, description="of that, seen alike less seen through")
    distinct: float = Field(0.12, gt=0, description="of agreement by which the next best place must be worse")
    inlier_distance: float = Field(0.08, gt=0, description="m across, of points that are taken for the same surface")
    inliers: float = Field(0.7, gt=0, le=1, description="of the points of the overlap")
    inlier_error: float = Field(0.035, gt=0, description="m, their mean distance across (RMSE)")
    moved: float = Field(0.35, gt=0, description="m by which the registration may leave the place that was found")
    turned: float = Field(0.06, gt=0, description="rad, likewise")
    held: float = Field(0.02, gt=0, le=1, description="of the points that must hold the direction that is held worst")
    alone: float = Field(0.3, ge=0, description="m; a larger correction needs several closures that agree")
    alone_turn: float = Field(0.03, ge=0, description="rad, likewise")
    together: int = Field(3, ge=2, description="closures that must agree where the correction is larger")
    apart: float = Field(4.0, gt=0, description="m of way over which they must be spread")
    rejoin: float = Field(0.1, gt=0, description="m; a larger correction has the walls of both passes joined anew")
    sigma_translation: float = Field(0.02, gt=0, description="m, of a closure, at the least")
    sigma_rotation: float = Field(0.004, gt=0, description="rad, likewise")
    huber: float = Field(3.0, gt=0, description="of whitened residuals")
    contradicted: float = Field(0.25, gt=0, description="m by which the graph may stay off a closure")
