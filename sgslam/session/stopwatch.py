"""Measures the time of each stage of a run."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter

STAGES = ("odometry", "surfaces", "rooms", "loops", "matching", "optimisation", "smoothing", "adjustment")


class Stopwatch:
    """Sums the seconds of each stage; `clock` is the wall clock by default."""

    def __init__(self, clock: Callable[[], float] = perf_counter) -> None:
        self.seconds: dict[str, float] = dict.fromkeys(STAGES, 0.0)
        self._clock = clock

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Context that adds its duration to the stage."""
        began = self._clock()
        try:
            yield
        finally:
            self.seconds[stage] += self._clock() - began
