"""How long each stage of a run takes."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter

STAGES = ("odometry", "surfaces", "rooms", "loops", "matching", "optimisation")


class Stopwatch:
    """Sums up the seconds of each stage, by the wall clock unless another `clock` is given."""

    def __init__(self, clock: Callable[[], float] = perf_counter) -> None:
        self.seconds: dict[str, float] = dict.fromkeys(STAGES, 0.0)
        self._clock = clock

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """What is done within counts for the stage."""
        began = self._clock()
        yield
        self.seconds[stage] += self._clock() - began
