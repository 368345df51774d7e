"""Matchers on maps with known truth: which maps, which methods, and what becomes of a match."""
