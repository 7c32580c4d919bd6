"""Joining a cluster: what is no address, and what nobody answers at."""

import socket
import threading

import pytest

from urbantwin.cluster import connected
from urbantwin.cluster.on_node import difference, told_here
from urbantwin.errors import InputError


@pytest.fixture
def listener():
    """A port at which something listens that is no cluster: it answers as a web server does."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer() -> None:
            try:
                while True:
                    other, _ = server.accept()
                    with other:
                        other.recv(100)
                        other.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")
            except OSError:
                return

        threading.Thread(target=answer, daemon=True).start()
        yield server.getsockname()[1]
        server.shutdown(socket.SHUT_RDWR)


def refused(address: str) -> str:
    with pytest.raises(InputError) as raised, connected(address):
        pass
    line = str(raised.value)
    assert line.startswith("--ray: ")
    assert "expected HOST:PORT" in line
    assert "\n" not in line
    return line


@pytest.mark.parametrize("address", ["", "x", "x:", ":1", "x:70000", "ray://head:10001", "x:1y"])
def test_what_is_no_address_is_refused(address):
    pytest.importorskip("ray")
    assert f"{address!r} is no address" in refused(address)


def test_where_nobody_listens_is_said_at_once():
    pytest.importorskip("ray")
    with socket.create_server(("127.0.0.1", 0)) as server:
        free = server.getsockname()[1]
    assert "no cluster can be reached" in refused(f"127.0.0.1:{free}")


def test_what_is_no_cluster_is_said(listener):
    pytest.importorskip("ray")
    assert "is no cluster's head" in refused(f"127.0.0.1:{listener}")


def test_another_version_on_a_node_is_named():
    here = told_here(lambda: {"python": "3.11", "dependencies": {"numpy": "2.1"}})
    assert {"UrbanTwin", "python", "numpy"} == set(here)
    assert difference(here, here) is None
    assert difference(here, {**here, "numpy": "2.0"}) == "numpy 2.0 (2.1 here)"
    assert difference(here, {"UrbanTwin": here["UrbanTwin"]}) == "python missing (3.11 here)"
