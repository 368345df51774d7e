"""The protocol of a matcher and of its answer."""

from collections.abc import Mapping
from typing import Any, Protocol

from data import SceneGraph


class Match(Protocol):
    """The answer of a matcher; `matching.MatchResult` is one."""

    @property
    def status(self) -> str:
        """`unique`, `ambiguous` or `none`."""
        ...

    @property
    def reason(self) -> str:
        """One line for the user."""
        ...

    @property
    def rooms(self) -> tuple[tuple[str, str, float], ...]:
        """(S id, A id, confidence) of the first hypothesis."""
        ...

    @property
    def wall_surfaces(self) -> tuple[tuple[str, str, float], ...]:
        """(S id, A id, confidence) of the first hypothesis."""
        ...

    @property
    def T_a_s(self) -> tuple[float, float, float] | None:  # noqa: N802
        """(yaw, x, y) of the first hypothesis in radians and metres; None without one."""
        ...

    @property
    def floor(self) -> str | None:
        """Id of the A floor of the first hypothesis."""
        ...

    def to_dict(self) -> Mapping[str, Any]:
        """Returns the answer as in `matches.json`."""
        ...


class AnyMatcher(Protocol):
    """Any object that finds where an S-graph is in an A-graph."""

    def match(self, s: SceneGraph, a: SceneGraph) -> Match:
        """Matches `s` with `a`; the status is `none` or `ambiguous` if no single answer fits."""
        ...
