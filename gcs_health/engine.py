"""One task over many items: on this machine's cores, or on a Dask cluster.

A task is a function at the top of a module, of one item; an item that raises or kills its worker is told and
the rest goes on. No scheduler of our own: processes are `concurrent.futures`', clusters Dask's.
"""

import gc
import os
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from typing import Any, NamedTuple, TypeVar

from gcs_health.errors import ConfigError

Item = TypeVar("Item")
Result = TypeVar("Result")
AHEAD = 3  # items handed out for each worker: none idles, and ten thousand futures are never alive
DIED = "the process that worked on it died (out of memory?)"


class Done(NamedTuple):
    """One item, done: its result, or why there is none."""

    item: Any
    result: Any
    error: str


def each(
    task: Callable[[Item], Result],
    items: Iterable[Item],
    *,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Iterator[Done]:
    """Yield every item once, in the order in which they end.

    Parameters
    ----------
    workers : processes on this machine; None = its cores, 1 = in this very process.
    scheduler : address of a Dask scheduler, tcp://HOST:PORT; it goes before `workers`.

    Raises
    ------
    ConfigError : the cluster cannot be reached, or Dask is not installed.
    """
    if scheduler is not None:
        return _on_cluster(task, items, scheduler)
    workers = workers or len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else workers
    if workers == 1:
        return (_here(task, item) for item in items)
    return _on_cores(task, items, workers or os.cpu_count() or 1)


def _here(task: Callable[[Item], Result], item: Item) -> Done:
    try:
        return Done(item, task(item), "")
    except Exception as error:
        return Done(item, None, _told(error))


def _on_cores(task: Callable[[Item], Result], items: Iterable[Item], workers: int) -> Iterator[Done]:
    source = iter(items)
    while True:
        suspects: deque[Item] = deque()  # in flight when a worker died: one of them killed it
        with _pool(workers) as pool:
            yield from _until_broken(pool, task, source, workers * AHEAD, suspects)
        if not suspects:
            return
        for item in suspects:
            with _pool(1) as pool:
                future = pool.submit(task, item)
                yield _outcome(item, future)


def _until_broken(
    pool: ProcessPoolExecutor,
    task: Callable[[Item], Result],
    source: Iterator[Item],
    ahead: int,
    suspects: deque[Item],
) -> Iterator[Done]:
    """Yield what ends well or badly; once a worker died, leave the items in flight to `suspects`."""
    running: dict[Future[Result], Item] = {}
    while True:
        while not suspects and len(running) < ahead:
            item = next(source, _END)
            if item is _END:
                break
            try:
                running[pool.submit(task, item)] = item
            except BrokenProcessPool:
                suspects.append(item)
        if not running:
            return
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            item = running.pop(future)
            if isinstance(future.exception(), BrokenProcessPool):
                suspects.append(item)
            else:
                yield _outcome(item, future)


_END: Any = object()


def _pool(workers: int) -> ProcessPoolExecutor:
    # spawn: a fork would copy whatever threads and locks the caller has
    return ProcessPoolExecutor(workers, get_context("spawn"), initializer=_prepare)


def _prepare() -> None:
    """A worker: one thread of arithmetic, the collector as the command line has it, ctrl-C is its parent's."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    gc.set_threshold(100_000, 20, 20)
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _outcome(item: Any, future: "Future[Any]") -> Done:
    error = future.exception()
    if error is None:
        return Done(item, future.result(), "")
    return Done(item, None, DIED if isinstance(error, BrokenProcessPool) else _told(error))


def _on_cluster(task: Callable[[Item], Result], items: Iterable[Item], address: str) -> Iterator[Done]:
    try:
        from distributed import Client, as_completed
    except ModuleNotFoundError:
        raise ConfigError("--scheduler needs Dask: pip install 'gcs-health[fleet]'") from None
    try:
        client = Client(address, timeout="10s")
    except (OSError, ValueError) as error:
        raise ConfigError(f"{address}: cannot reach a Dask scheduler there: {error}") from None
    source = iter(items)
    with client:
        ahead = AHEAD * max(sum(client.nthreads().values()), 1)
        item_of: dict[str, Item] = {}
        running = as_completed(with_results=False)

        def submit() -> None:
            item = next(source, _END)
            if item is not _END:
                # pure=False: two logs of one name are two tasks; Dask moves a dead worker's tasks to others
                future = client.submit(task, item, pure=False)
                item_of[future.key] = item
                running.add(future)

        for _ in range(ahead):
            submit()
        for future in running:
            item = item_of.pop(future.key)
            raised = future.exception()
            yield Done(item, None if raised else future.result(), _told(raised) if raised else "")
            future.release()
            submit()


def _told(error: BaseException) -> str:
    said = " ".join(str(error).split())
    return said if type(error).__module__.startswith("gcs_health") else f"{type(error).__name__}: {said}"
