"""A building that differs from its plan: what is elsewhere, not built, or not planned."""

from data.simulation.changes.changes import Change, Changes

__all__ = ["Change", "Changes"]
