"""Measures the time of each stage of a run."""

from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter

STAGES = ("odometry", "surfaces", "rooms", "loops", "matching", "optimisation", "smoothing", "adjustment")


class Stopwatch:
    """Sums the seconds of each stage by the wall clock."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = dict.fromkeys(STAGES, 0.0)

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Context that adds its duration to the stage."""
        began = perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] += perf_counter() - began
