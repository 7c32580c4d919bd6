"""Workers on a Ray cluster, with the interface of a process pool; lost tasks are repeated."""

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

#: Most repetitions of a task whose worker or node was lost.
MOST_RETRIES = 4
#: Longest time without any node, seconds; a restarted node needs a while.
_LONGEST_ALONE_S = 60.0
_LOOKED_AFTER_S = 5.0
_THEN = "what is finished is kept: give the same command again"


class ClusterWorkers:
    """Workers that run ``start`` once per process, and then the submitted tasks.

    The start data is sent to every node once. A killed worker or lost node is replaced, and its
    task repeated elsewhere; after four repetitions the task fails.

    Args:
        start: called in every worker before its work.
        arguments: arguments of ``start``.
        agreed: see `connected`.
        told: return value of ``agreed`` on this machine.
        workers: largest number of parallel tasks.

    Attributes:
        workers: number of parallel tasks.
        room: number of tasks worth submitting before the first has ended.
        handed: Ray's reference to the start data.
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
        """Submit a function call; return a future of its result or exception.

        Args:
            function: module-level function, not of a script.
            arguments: its arguments; they and the result are pickled.
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
        """Stop all running tasks."""
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
        except Exception as error:  # Ray's own error, passed on through the future
            well, what = False, StageError(f"{_why(error)}; {_THEN}")
        if well:
            future.set_result(what)
        else:
            future.set_exception(what)

    def _watch_nodes(self) -> None:
        """Fail waiting tasks after a minute without any node; Ray would wait forever."""
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
    """Return Ray's entries of living nodes that have a processor."""
    import ray

    nodes: list[dict[str, Any]] = ray.nodes()  # type: ignore[no-untyped-call, unused-ignore]
    return [one for one in nodes if one["Alive"] and one["Resources"].get("CPU", 0) >= 1]


def processors() -> int:
    """Return the total number of processors of the living nodes."""
    return int(sum(one["Resources"]["CPU"] for one in working_nodes()))


def _why(error: BaseException) -> str:
    """Return a description of Ray's error for a task that was lost too often."""
    import ray

    if isinstance(error, ray.exceptions.OutOfMemoryError):
        return "workers were killed for want of memory, the same task again and again"
    lost = (ray.exceptions.WorkerCrashedError, ray.exceptions.NodeDiedError)
    if isinstance(error, lost):
        return f"a task lost its worker or its node {MOST_RETRIES + 1} times (out of memory?)"
    first = str(error).strip().splitlines()
    return f"the cluster lost a task ({first[-1] if first else type(error).__name__})"
