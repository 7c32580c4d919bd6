"""Workers on a cluster, with the face of a pool of processes. A task that is lost is done again."""

from __future__ import annotations

import pickle
import threading
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from typing import Any, TypeVar

from urbantwin.cluster.on_node import begin_and_work
from urbantwin.errors import StageError

__all__ = ["ClusterWorkers", "processors", "working_nodes"]

Result = TypeVar("Result")

#: A task whose worker or node was lost is begun so many times more.
MOST_RETRIES = 4
#: So long nobody has to be there to do the work: a node that is started again takes a while.
_LONGEST_ALONE_S = 60.0
_LOOKED_AFTER_S = 5.0
_THEN = "what is finished is kept: give the same command again"


class ClusterWorkers:
    """Workers that are begun once in each process with ``start``, and then do what is submitted.

    What they begin with reaches every node once. A worker that is killed, or whose node is lost,
    is replaced, and its task is done again on another; after four such losses of one task it fails.

    Args:
        start: called in every worker before its work.
        arguments: of ``start``.
        agreed: see `connected`.
        told: what it returned here.
        workers: at most so many at a time.

    Attributes:
        workers: how many work at a time.
        room: so many tasks are worth submitting before the first has ended.
        handed: Ray's reference to what the workers begin with.
    """

    def __init__(
        self,
        start: Callable[..., None],
        arguments: tuple[object, ...],
        agreed: Callable[[], Any] | None,
        told: dict[str, str],
        workers: int | None,
    ) -> None:
        import ray

        there = processors()
        self.workers = max(there if workers is None else min(workers, there), 1)
        self.room = self.workers * 3 if workers is None or workers > there else self.workers
        packed = pickle.dumps((start, arguments, agreed, told), pickle.HIGHEST_PROTOCOL)
        self.handed = ray.put(packed)
        self._work = ray.remote(num_cpus=1, max_retries=MOST_RETRIES, retry_exceptions=False)(
            begin_and_work
        )
        self._waiting: dict[Future[Any], Any] = {}
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._watch = threading.Thread(target=self._watch_nodes, daemon=True)
        self._watch.start()

    def submit(self, function: Callable[..., Result], *arguments: object) -> Future[Result]:
        """Let a worker call a function; the future has what it returned, or raises what it raised.

        Args:
            function: of a module, not of a script.
            arguments: of it; they and the result are pickled.
        """
        packed = pickle.dumps((function, arguments), pickle.HIGHEST_PROTOCOL)
        reference = self._work.remote([self.handed], packed)
        future: Future[Result] = Future()
        future.set_running_or_notify_cancel()
        with self._lock:
            self._waiting[future] = reference
        reference.future().add_done_callback(lambda done: self._settle(future, done))
        return future

    def close(self) -> None:
        """Stop what has not ended."""
        import ray

        self._closed.set()
        with self._lock:
            left = dict(self._waiting)
            self._waiting.clear()
        for reference in left.values():
            with suppress(Exception):
                ray.cancel(reference, force=True)
        if left:
            with suppress(Exception):
                ray.wait(list(left.values()), num_returns=len(left), timeout=10.0)

    def _settle(self, future: Future[Any], done: Future[bytes]) -> None:
        with self._lock:
            if self._waiting.pop(future, None) is None:  # closed, or given up
                return
        try:
            well, what = pickle.loads(done.result())
        except Exception as error:  # Ray's own: whoever waits for the future hears of it
            well, what = False, StageError(f"{_why(error)}; {_THEN}")
        if well:
            future.set_result(what)
        else:
            future.set_exception(what)

    def _watch_nodes(self) -> None:
        """End the waiting when no node has been left for a minute: Ray would wait for ever."""
        alone_s = 0.0
        while not self._closed.wait(_LOOKED_AFTER_S):
            try:
                there = processors()
            except Exception:
                there = 0
            alone_s = 0.0 if there else alone_s + _LOOKED_AFTER_S
            if alone_s >= _LONGEST_ALONE_S:
                with self._lock:
                    left = list(self._waiting)
                    self._waiting.clear()
                for future in left:
                    future.set_exception(StageError(f"no node of the cluster is left; {_THEN}"))


def working_nodes() -> list[dict[str, Any]]:
    """Return what Ray tells of the nodes that are alive and have a processor."""
    import ray

    nodes: list[dict[str, Any]] = ray.nodes()  # type: ignore[no-untyped-call, unused-ignore]
    return [one for one in nodes if one["Alive"] and one["Resources"].get("CPU", 0) >= 1]


def processors() -> int:
    """Return how many processors the nodes have that are alive."""
    return int(sum(one["Resources"]["CPU"] for one in working_nodes()))


def _why(error: BaseException) -> str:
    """Return what Ray's error says of a task that was lost too often."""
    import ray

    if isinstance(error, ray.exceptions.OutOfMemoryError):
        return "workers were killed for want of memory, the same task again and again"
    lost = (ray.exceptions.WorkerCrashedError, ray.exceptions.NodeDiedError)
    if isinstance(error, lost):
        return f"a task lost its worker or its node {MOST_RETRIES + 1} times (out of memory?)"
    first = str(error).strip().splitlines()
    return f"the cluster lost a task ({first[-1] if first else type(error).__name__})"
