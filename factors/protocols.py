"""What `anchors_of` needs of a match and of a plan, which may be of any class with these attributes.

`matching.MatchResult` and `data.SceneGraph` have them.
"""

from collections.abc import Mapping, Sequence
from typing import Protocol


class Match(Protocol):
    """Where a map lies in a plan; see `matching.MatchResult`."""

    @property
    def status(self) -> str:
        """`unique`, or something else where the place is not certain."""

    @property
    def reason(self) -> str:
        """The status explained in one line."""

    @property
    def T_a_s(self) -> tuple[float, float, float] | None:  # noqa: N802
        """(yaw, x, y) in rad and m, from the map to the BIM frame: p_bim = R(yaw) p_map + (x, y)."""

    @property
    def wall_surfaces(self) -> Sequence[tuple[str, str, float]]:
        """Matched wall surfaces as (id in the map, id in the plan, confidence)."""


class PlannedSurface(Protocol):
    """A wall surface of a plan; see `data.WallSurface`."""

    @property
    def centroid(self) -> tuple[float, float]:
        """(x, y) of the footprint's mid point in the BIM frame, in metres."""

    @property
    def normal(self) -> tuple[float, float]:
        """(x, y) towards the side from which it is seen."""


class Plan(Protocol):
    """A plan; see `data.SceneGraph`."""

    @property
    def surface_by_id(self) -> Mapping[str, PlannedSurface]:
        """Its wall surfaces by id."""
