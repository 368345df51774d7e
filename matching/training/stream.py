"""Batches prepared in advance by other processes, in the order of steps."""

import multiprocessing
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
from itertools import count

from data.common.children import end_with_parent
from data.common.cluster import in_order
from matching.training.data import Batch, Drawing

AHEAD = 6  # batches that wait, of each process
_drawing: list[Drawing] = []  # of a worker process


def _begin(drawing: Drawing) -> None:
    end_with_parent()
    _drawing.append(drawing)


def _batch(seed: int, step: int) -> Batch:
    return _drawing[0].batch(seed, step)


@contextmanager
def batches(
    drawing: Drawing, seed: int, first: int, workers: int, scheduler: str | None = None
) -> Iterator[Iterator[Batch]]:
    """Yields the batches of steps `first`, `first` + 1, ...; they do not depend on who draws them.

    Raises what a worker raises, BrokenProcessPool if one dies, and UserError as `data.common.cluster` does.
    """
    if scheduler is not None:
        yield in_order(partial(drawing.batch, seed), count(first), scheduler)
    elif workers == 0:
        yield map(partial(drawing.batch, seed), count(first))
    else:
        context = multiprocessing.get_context("spawn")
        pool = ProcessPoolExecutor(workers, context, _begin, (drawing,))
        try:
            yield _in_order(pool, seed, first, AHEAD * workers)
        finally:
            pool.shutdown(cancel_futures=True)


def _in_order(pool: ProcessPoolExecutor, seed: int, first: int, ahead: int) -> Iterator[Batch]:
    waiting: deque[Future[Batch]] = deque()
    for step in count(first):
        waiting.append(pool.submit(_batch, seed, step))
        if len(waiting) > ahead:
            yield waiting.popleft().result()
