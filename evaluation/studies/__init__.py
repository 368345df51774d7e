"""The ten studies, one question each."""
