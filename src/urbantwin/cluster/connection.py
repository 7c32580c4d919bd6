"""Connection to a Ray cluster, with incompatibilities reported in one line."""

from __future__ import annotations

import logging
import os
import pickle
import secrets
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from urbantwin.cluster.on_node import Agreed, answer, difference, told_here
from urbantwin.cluster.workers import ClusterWorkers, processors, working_nodes
from urbantwin.errors import InputError, StageError
from urbantwin.extras import check_extra
from urbantwin.processes import usable_processors

__all__ = ["Cluster", "connected"]

Result = TypeVar("Result")

#: Time limit for a response of an address, seconds.
_ANSWERS_S = 5.0
#: Time limit for a node to import this package, seconds.
_NODE_ANSWERS_S = 120.0
#: Start of an HTTP/2 connection (RFC 9113, 3.4), as a head node speaks it: preface and settings,
#: with a settings frame from both sides. Ray itself would wait 80 s for another kind of server.
_SETTINGS = b"\x04"
_HELLO = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0" + _SETTINGS + bytes(5)
_WAITS = "RAY_gcs_server_port_wait_time_s"
_MODE, _TOKEN = "RAY_AUTH_MODE", "RAY_AUTH_TOKEN"
_EXPECTED = "HOST:PORT of a cluster's head, auto for the one that runs here, or local to start one"


class Cluster:
    """A joined cluster.

    Attributes:
        address: address given by the user.
        processors: total number of processors of its nodes.
        nodes: addresses of its working nodes.
        workers: largest number of parallel tasks; all processors if not given.
    """

    def __init__(self, address: str, agreed: Agreed | None, workers: int | None = None) -> None:
        self.address = address
        self.workers = workers
        self._agreed = agreed
        self._told = told_here(agreed)
        self._check_versions()

    @property
    def processors(self) -> int:
        """Total number of processors of the nodes."""
        return processors()

    @property
    def nodes(self) -> list[str]:
        """Names of the working nodes, as used in errors."""
        return [_name(one) for one in working_nodes()]

    @contextmanager
    def worker_pool(
        self, start: Callable[..., None], *arguments: object, workers: int | None = None
    ) -> Iterator[ClusterWorkers]:
        """Yield workers as `processes.worker_pool` does; stop running tasks at the end.

        Args:
            start: called in every worker before its work.
            arguments: arguments of ``start``, sent to every node once.
            workers: largest number of parallel tasks; the cluster's if not given.
        """
        most = self.workers if workers is None else workers
        pool = ClusterWorkers(start, arguments, self._agreed, self._told, most)
        try:
            yield pool
        finally:
            pool.close()

    def on_every_node(
        self, function: Callable[..., Result], *arguments: object
    ) -> dict[str, Result]:
        """Call a function once on every working node; return the results by node name.

        Raises:
            StageError: a node does not respond.
        """
        import ray
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        packed = pickle.dumps((function, arguments), pickle.HIGHEST_PROTOCOL)
        work = ray.remote(num_cpus=0, max_retries=0)(answer)
        asked = {}
        for one in working_nodes():
            on = NodeAffinitySchedulingStrategy(one["NodeID"], soft=False)
            asked[_name(one)] = work.options(scheduling_strategy=on).remote(packed)
        ray.wait(list(asked.values()), num_returns=len(asked), timeout=_NODE_ANSWERS_S)
        told: dict[str, Result] = {}
        for name, reference in asked.items():
            try:
                well, what = pickle.loads(ray.get(reference, timeout=0.1))
            except ray.exceptions.GetTimeoutError:
                raise StageError(
                    f"node {name} of the cluster has not answered for {_NODE_ANSWERS_S:g} s"
                ) from None
            except Exception as error:
                raise _not_usable(name, error) from None
            if not well:
                raise _of_node(name, what)
            told[name] = what
        return told

    def _check_versions(self) -> None:
        if not working_nodes():
            raise InputError(
                "has no node with a processor", place="--ray", expected="a cluster that can work"
            )
        for name, there in self.on_every_node(told_here, self._agreed).items():
            other = difference(self._told, there)
            if other is not None:
                raise InputError(
                    f"node {name} has {other}",
                    place="--ray",
                    expected="the same versions on every node: they decide the bytes",
                )


@contextmanager
def connected(
    address: str, *, agreed: Agreed | None = None, workers: int | None = None
) -> Iterator[Cluster]:
    """Join a Ray cluster for a block.

    Args:
        address: ``HOST:PORT`` of its head; ``auto``, the cluster running on this machine;
            ``local``, a new one that ends with the block.
        agreed: a module-level function, called here and on every node, which returns the values
            that must be equal on all. The version of UrbanTwin is always compared.
        workers: largest number of parallel tasks; all processors if not given.

    Raises:
        InputError: Ray is not installed, no cluster is at the address, its versions differ, or a
            node differs in a version that affects the bytes.
        StageError: a node does not respond.
    """
    check_extra("ray", "working on a cluster", place="--ray")
    # No usage statistics, and no output but ours.
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    import ray

    if ray.is_initialized():  # the caller has joined one
        yield Cluster(address, agreed, workers)
        return
    _check_address(address)
    with _own_signals():
        _join(address, workers)
    try:
        with _without_remarks():
            yield Cluster(address, agreed, workers)
    finally:
        with _own_signals():
            ray.shutdown()


def _check_address(address: str) -> None:
    """Check that an address is valid and that a cluster's head responds there."""
    if address in ("auto", "local"):
        return
    host, _, port = address.rpartition(":")
    if "://" in address or not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise InputError(f"{address!r:.80} is no address", place="--ray", expected=_EXPECTED)
    try:
        with socket.create_connection((host.strip("[]"), int(port)), _ANSWERS_S) as asked:
            asked.settimeout(_ANSWERS_S)
            asked.sendall(_HELLO)
            answered = asked.recv(9)
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise InputError(
            f"no cluster can be reached at {address} ({why})", place="--ray", expected=_EXPECTED
        ) from None
    if answered[3:4] != _SETTINGS and not os.environ.get("RAY_USE_TLS"):
        raise InputError(
            f"what listens at {address} is no cluster's head", place="--ray", expected=_EXPECTED
        )


def _join(address: str, workers: int | None) -> None:
    import ray

    options: dict[str, Any] = {}
    told = {_WAITS: "2"}  # attempts of a few seconds; Ray's default is twenty
    if address == "local":
        options = {"include_dashboard": False}
        options["num_cpus"] = usable_processors() if workers is None else workers
        told = {}
        if not {_MODE, _TOKEN}.intersection(os.environ):
            # A temporary token: Ray would leave one in the user's home folder.
            told = {_TOKEN: secrets.token_hex(32)}
    try:
        with _environment(told), _silent():
            ray.init(address, log_to_driver=False, logging_level=logging.CRITICAL, **options)
    except ConnectionError:
        where = "on this machine" if address == "auto" else f"at {address}"
        raise InputError(
            f"no Ray cluster answers {where}, or it asks for a token",
            place="--ray",
            expected=f"{_EXPECTED}; with RAY_AUTH_MODE and RAY_AUTH_TOKEN as on its head",
        ) from None
    except Exception as error:
        raise InputError(
            f"{address} cannot be joined ({_reason(error)})", place="--ray", expected=_EXPECTED
        ) from None


@contextmanager
def _environment(told: dict[str, str]) -> Iterator[None]:
    """Set environment variables for Ray while the block runs."""
    before = {name: os.environ.get(name) for name in (*told, _MODE)}  # Ray sets the mode itself
    os.environ.update(told)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextmanager
def _without_remarks() -> Iterator[None]:
    """Keep Ray's notices about repeated tasks off stdout, which carries results."""
    from ray._private import worker  # no setting turns it off (2.60)

    name = "print_to_stdstream"
    before = getattr(worker, name, None)
    setattr(worker, name, lambda *_, **__: None)
    try:
        yield
    finally:
        setattr(worker, name, before)


@contextmanager
def _silent() -> Iterator[None]:
    """Hide what Ray's own code writes to stderr, but nothing else."""
    shown = sys.stderr
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        is_ours = shown.fileno() == 2
    except (AttributeError, OSError, ValueError):
        is_ours = False
    with os.fdopen(kept, "w", buffering=1, encoding="utf-8") as stream:
        os.dup2(nowhere, 2)
        if is_ours:
            sys.stderr = stream
        try:
            yield
        finally:
            sys.stderr = shown
            stream.flush()
            os.dup2(kept, 2)
            os.close(nowhere)


def _reason(error: Exception) -> str:
    said = " ".join(str(error).split())
    if "ersion mismatch" in said:
        return said[said.index("ersion mismatch") - 1 :]
    return said


def _of_node(name: str, error: Exception) -> Exception:
    """Return an input error with the node's name added to its place."""
    if not isinstance(error, InputError):
        return error
    place = f"node {name}" if error.place is None else f"node {name}: {error.place}"
    return InputError(error.problem, file=error.file, place=place, expected=error.expected)


def _not_usable(name: str, error: Exception) -> InputError:
    said = str(error)
    if "urbantwin" in said and ("import" in said or "No module" in said):
        problem = f"node {name} has no UrbanTwin"
    else:
        lines = said.strip().splitlines()
        problem = f"node {name} cannot work ({lines[-1] if lines else type(error).__name__})"
    return InputError(
        problem, place="--ray", expected="the same versions of UrbanTwin and Python on every node"
    )


def _name(node: dict[str, Any]) -> str:
    host, address = node["NodeManagerHostname"], node["NodeManagerAddress"]
    return f"{host} ({address}, {node['NodeID'][:6]})"


@contextmanager
def _own_signals() -> Iterator[None]:
    """Keep this process's signal handlers, since Ray replaces that of SIGTERM."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {one: signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            if handler is not None:
                signal.signal(number, handler)
