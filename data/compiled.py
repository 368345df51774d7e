"""Functions compiled to machine code, for the few loops over points or pairs that numpy has no word for."""

from collections.abc import Callable
from typing import TypeVar

from numba import njit

_F = TypeVar("_F", bound=Callable[..., object])


def compiled(function: _F) -> _F:
    """`function` compiled by numba at its first call with arguments of a kind; kept on disk for later processes.

    Where no folder for it can be written (a read-only installation without a home), each process compiles anew.
    IEEE arithmetic is kept as written (no fastmath), so that results are the same on each call.
    """
    try:
        fast: _F = njit(function, cache=True, nogil=True)
    except RuntimeError:  # "cannot cache function: no locator available"
        fast = njit(function, nogil=True)
    return fast


@compiled
def _first(number: float) -> float:
    return number


_first(0.0)  # numba makes itself ready at its first call, a quarter of a second: at import, not in a robot's first scan
