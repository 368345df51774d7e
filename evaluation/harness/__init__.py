"""Shared parts of the measurements: sequences, records, pages, stand-in matchers."""
