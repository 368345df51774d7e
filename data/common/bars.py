"""Bars of a command's long stages, on a terminal; elsewhere, and for users of the library, nothing is printed."""

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from rich.progress import Progress

T = TypeVar("T")
_shown: ContextVar["Progress | None"] = ContextVar("the bars of a command", default=None)


@contextmanager
def bars() -> Iterator["Progress"]:
    """Context in which stages have bars."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(console=console, disable=not console.is_terminal, transient=True) as own:
        before = _shown.set(own)
        try:
            yield own
        finally:
            _shown.reset(before)


def steps(items: Collection[T], stage: str) -> Iterator[T]:
    """The items, the steps of a stage."""
    own = _shown.get()
    if own is None:
        yield from items
        return
    task = own.add_task(stage, total=len(items))
    try:
        for item in items:
            yield item
            own.advance(task)
    finally:
        own.remove_task(task)
