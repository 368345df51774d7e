"""The entries of deviations.json: each is a wall surface that differs from the plan, or that was checked against it.

`s_id` is a surface of the S-graph, `a_id` one of the A-graph, `source` the id of the planned wall in its file.
`significant` is true where the difference exceeds the measurement error; `reason` explains the decision.
"""

from typing import Literal, TypedDict

from data.scene_graph import Xy


class MovedDeviation(TypedDict):
    """A mapped surface that corresponds to a planned one.

    `offset_m` is its distance from the planned place, along the plan's inward normal; `tilt_rad` is its rotation
    about the vertical; `sigma_m` is the standard deviation of the offset.
    """

    s_id: str
    a_id: str
    source: str
    kind: Literal["moved"]
    offset_m: float
    tilt_rad: float
    sigma_m: float
    significant: bool
    reason: str


class AbsentDeviation(TypedDict):
    """A planned surface that is absent: the scans see through its place."""

    s_id: None
    a_id: str
    source: str
    kind: Literal["absent"]
    offset_m: None
    tilt_rad: None
    sigma_m: None
    significant: bool
    reason: str


class ExtraDeviation(TypedDict):
    """A mapped surface where the plan has no wall.

    `trace` are the ends in plan view of the part that is not planned (BIM frame, metres).
    """

    s_id: str
    a_id: None
    source: str
    kind: Literal["extra"]
    trace: tuple[Xy, Xy]
    offset_m: None
    tilt_rad: None
    sigma_m: None
    significant: bool
    reason: str


Deviation = MovedDeviation | AbsentDeviation | ExtraDeviation
