"""Times of several things, measured in turns: a busy machine slows all of them alike."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter, process_time


@dataclass(frozen=True)
class Seconds:
    """Wall-clock and CPU seconds (all threads of this process)."""

    wall: float
    cpu: float


def in_turns(functions: Sequence[Callable[[], object]], repeat: int, warm: bool = False) -> list[list[Seconds]]:
    """The seconds of each function in each of `repeat` turns.

    If `warm`, each is called once before each measurement, since the CPU's caches hold another function's data.
    """
    times: list[list[Seconds]] = [[] for _ in functions]
    for _ in range(repeat):
        for function, own in zip(functions, times, strict=True):
            if warm:
                function()
            own.append(seconds_of(function))
    return times


def seconds_of(function: Callable[[], object]) -> Seconds:
    """The seconds of one call."""
    began, used = perf_counter(), process_time()
    function()
    return Seconds(perf_counter() - began, process_time() - used)
