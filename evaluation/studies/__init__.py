"""The eleven studies, one question each."""
