"""Batches prepared in advance by worker processes, in the order of steps."""

import multiprocessing as mp
import queue
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from itertools import count
from typing import Any

from matching.training.data import Batch, Drawing

AHEAD = 6  # batches that wait, of each process
PATIENCE_S = 5.0


def _work(drawing: Drawing, seed: int, first: int, every: int, out: Any) -> None:
    step = first
    try:
        while True:
            out.put(drawing.batch(seed, step))
            step += every
    except KeyboardInterrupt:
        return
    except Exception as error:
        out.put(RuntimeError(f"drawing batch {step}: {type(error).__name__}: {error}"))
        raise


@contextmanager
def batches(
    drawing: Drawing, seed: int, first: int, workers: int, scheduler: str | None = None
) -> Iterator[Iterator[Batch]]:
    """Yields the batches of steps `first`, `first` + 1, ...; they do not depend on the number of workers or the
    cluster.

    Raises RuntimeError if a worker fails, and UserError as `data.common.cluster` does.
    """
    if scheduler is not None:
        from data.common.cluster import in_order

        yield in_order(partial(drawing.batch, seed), count(first), scheduler)
        return
    if workers == 0:
        yield (drawing.batch(seed, step) for step in count(first))
        return
    context = mp.get_context("spawn")
    queues = [context.Queue(AHEAD) for _ in range(workers)]
    processes = [
        context.Process(target=_work, args=(drawing, seed, first + k, workers, q), daemon=True)
        for k, q in enumerate(queues)
    ]
    for process in processes:
        process.start()
    try:
        yield (_next(queues[k % workers], processes[k % workers]) for k in count())
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.join()


def _next(source: Any, process: Any) -> Batch:
    while True:
        try:
            item = source.get(timeout=PATIENCE_S)
        except queue.Empty:
            if process.is_alive():
                continue
            raise RuntimeError("a process that draws batches has died") from None
        if isinstance(item, Exception):
            raise item
        assert isinstance(item, Batch)
        return item
