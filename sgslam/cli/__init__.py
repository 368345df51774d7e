"""The commands: their options, how a run is set up and fed, self tests."""
