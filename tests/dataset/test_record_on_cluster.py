"""Frames on a Ray cluster of two nodes on this machine, one of which is killed."""

import importlib
import os
import time
from collections.abc import Iterator

import numpy as np
import pytest

from urbantwin.artefact.storage import Storage
from urbantwin.cluster import connected
from urbantwin.dataset import record
from urbantwin.errors import InputError, StageError

ray = pytest.importorskip("ray", reason="the extra 'ray' is not installed")

#: One cluster for all tests of this file: it takes some seconds to start.
pytestmark = [
    pytest.mark.xdist_group("cluster"),
    pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::FutureWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]
_STORE = 80 * 2**20
#: A module that the nodes can import, which those of tests are not.
_WORK = """
import os
import time

import ray
from urbantwin.errors import InputError


def begin(_array, folder):
    with open(f"{folder}/{os.getpid()}", "a") as stream:
        stream.write("begun ")


def where(array):
    time.sleep(0.3)
    return ray.get_runtime_context().get_node_id(), os.getpid(), array.flags.writeable


def fail(how):
    if how == "input":
        raise InputError("is wrong", file="a.yaml", place="b", expected="c")
    if how == "disk":
        raise OSError(28, "No space left on device", "/a/b")
    os._exit(1)
"""


@pytest.fixture(scope="module")
def nodes(tmp_path_factory) -> Iterator[list]:
    """A head and one more node with one processor each; nobody else is told of them."""
    from ray.cluster_utils import Cluster

    folder = tmp_path_factory.mktemp("work")
    (folder / "work_of_nodes.py").write_text(_WORK)
    own = {"num_cpus": 1, "object_store_memory": _STORE}
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        patch.setenv("PYTHONPATH", str(folder), prepend=os.pathsep)
        patch.setenv("RAY_worker_niceness", "0")  # 15 else: a busy machine would never come to it
        head = {**own, "include_dashboard": False}
        started = Cluster(initialize_head=True, head_node_args=head)
        try:
            yield [started, started.add_node(**own)]
        finally:
            started.shutdown()


@pytest.fixture(scope="module")
def work(nodes):
    """The module that the nodes can import."""
    return importlib.import_module("work_of_nodes")


@pytest.fixture(scope="module")
def cluster(nodes):
    with connected(nodes[0].address) as joined:
        yield joined


def test_workers_begin_once_and_each_node_gets_what_they_share_once(cluster, work, tmp_path):
    shared = np.zeros(1_000_000)
    with cluster.worker_pool(work.begin, shared, tmp_path) as pool:
        assert (pool.workers, len(cluster.nodes)) == (2, 2)
        futures = [pool.submit(work.where, np.arange(50_000)) for _ in range(9)]
        places = [one.result(300) for one in futures]
        assert all(writeable for *_, writeable in places)
        used = {node for node, *_ in places}
        held = ray.experimental.get_object_locations([pool.handed])[pool.handed]
        assert held["object_size"] > shared.nbytes
        assert sorted(held["node_ids"]) == sorted({*used, ray.get_runtime_context().get_node_id()})
        assert len(used) > 1
    begun = {int(one.name): one.read_text().split() for one in tmp_path.iterdir()}
    assert all(len(lines) == 1 for lines in begun.values())
    assert {pid for _, pid, _ in places} <= set(begun)


def test_errors_come_back_as_themselves_and_a_task_that_kills_its_worker_ends(
    cluster, work, tmp_path, monkeypatch
):
    monkeypatch.setattr("urbantwin.cluster.workers.MOST_RETRIES", 1)
    with cluster.worker_pool(work.begin, None, tmp_path) as pool:
        with pytest.raises(InputError, match=r"^a.yaml: b: is wrong; expected c$"):
            pool.submit(work.fail, "input").result(300)
        with pytest.raises(OSError, match="No space left") as raised:
            pool.submit(work.fail, "disk").result(300)
        assert (raised.value.errno, raised.value.filename) == (28, "/a/b")
        with pytest.raises(StageError, match=r"lost its worker .* 2 times.*same command again"):
            pool.submit(work.fail, "killed").result(300)


def test_a_folder_that_a_node_does_not_see_is_refused_before_any_work(cluster, twin, motion, rig):
    """Storage in the memory of one process stands for a disk of one machine."""
    out = Storage.of("memory://of-this-process/dataset")
    with pytest.raises(InputError, match=r"memory://.*node .*is not seen from there"):
        record(twin, motion, rig, out, workers=cluster, seed=5)


@pytest.mark.thorough
def test_a_node_is_killed_and_the_bytes_are_those_of_one_worker(
    cluster, nodes, twin, motion, rig, dataset, tmp_path
):
    started, victim = nodes
    out = tmp_path / "dataset"
    told = []

    def progress(_share: float, doing: str) -> None:
        told.append(doing)
        if doing.startswith("frame 2 "):
            started.remove_node(victim, allow_graceful=False)
            deadline = time.monotonic() + 60
            while len(cluster.nodes) == 2 and time.monotonic() < deadline:
                time.sleep(0.2)

    record(twin, motion, rig, out, workers=cluster, seed=5, progress=progress)
    assert (out / "SHA256SUMS").read_bytes() == (dataset / "SHA256SUMS").read_bytes()
    assert "frame 12 of 12" in told
    assert len(cluster.nodes) == 1

    stored = tmp_path / "stored"
    record(twin, motion, rig, Storage.of(f"file://{stored}"), workers=cluster, seed=5)
    assert (stored / "SHA256SUMS").read_bytes() == (dataset / "SHA256SUMS").read_bytes()
    assert not (stored / ".urbantwin-partial").exists()
