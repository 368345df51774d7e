"""Functions compiled to machine code, for the few loops over points or pairs that numpy has no word for."""

import gc
import os
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

from numba import njit, types
from numba.core import event
from numba.core.dispatcher import Dispatcher
from numba.extending import intrinsic

_F = TypeVar("_F", bound=Callable[..., object])


def compiled(function: _F) -> _F:
    """`function` compiled by numba at its first call with arguments of a kind; kept on disk for later processes.

    Where no folder for it can be written (a read-only installation without a home), each process compiles anew.
    IEEE arithmetic is kept as written (no fastmath; x / 0 is infinite), so that results are the same on each call.
    """
    return _compiled(function, inline="never")


def compiled_within(function: _F) -> _F:
    """As `compiled`, but as a part of the compiled function that calls it: for a long one with one caller, which would
    be compiled by itself first and then again within that."""
    return _compiled(function, inline="always")


def _compiled(function: _F, inline: str) -> _F:
    options = {"nogil": True, "error_model": "numpy", "inline": inline, "no_cfunc_wrapper": True}
    try:
        fast: Any = njit(function, cache=True, **options)
    except RuntimeError:  # "cannot cache function: no locator available"
        fast = njit(function, **options)
    else:
        key = fast._cache._index_key
        fast._cache._index_key = lambda *kind: (*key(*kind), *_made_of(function, {function}))
    kept: _F = fast
    return kept


def _made_of(function: Callable[..., object], known: set[Callable[..., object]]) -> Iterator[tuple[object, ...]]:
    """What the machine code of a function holds of other files, to be kept with it: the compiled functions that it
    calls, as their files are now, and the numbers. By itself numba looks at a function's own file alone, and goes on
    with the old ones of others after an update."""
    for name in function.__code__.co_names:
        value = function.__globals__.get(name)
        if isinstance(value, int | float | tuple):
            yield name, repr(value)
        elif isinstance(value, Dispatcher) and value.py_func not in known:
            known.add(value.py_func)
            path = value.py_func.__code__.co_filename
            state = os.stat(path) if os.path.exists(path) else None
            yield name, state and (state.st_mtime_ns, state.st_size)
            yield from _made_of(value.py_func, known)


class _Uncollected(event.Listener):  # type: ignore[misc]
    """No search for garbage while functions are compiled: it takes a fifth of that time, and finds hardly any."""

    def __init__(self) -> None:
        self._depth, self._before = 0, False

    def on_start(self, event: event.Event) -> None:
        """A function may lead to others that are compiled within it."""
        if self._depth == 0:
            self._before = gc.isenabled()
            gc.disable()
        self._depth += 1

    def on_end(self, event: event.Event) -> None:
        """Also where it cannot be compiled."""
        self._depth -= 1
        if self._depth == 0 and self._before:
            gc.enable()


event.register("numba:compile", _Uncollected())


@intrinsic  # type: ignore[untyped-decorator]
def power_of_two(typing_context: Any, exponent: Any) -> Any:
    """2 to a whole power from -126 to 127, both in single precision; for compiled functions."""

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        real = context.get_value_type(types.float32)
        whole = context.get_value_type(types.int32)
        bits = builder.shl(builder.add(builder.fptosi(arguments[0], whole), whole(127)), whole(23))
        return builder.bitcast(bits, real)

    return types.float32(types.float32), code


@compiled
def _first(number: float) -> float:
    return number


_first(0.0)  # numba makes itself ready at its first call, a quarter of a second: at import, not in a robot's first scan
