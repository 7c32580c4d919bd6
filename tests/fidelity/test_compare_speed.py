"""Nearest points by our tree, and `compare` on several processes: the same, and nothing left."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

import urbantwin
from urbantwin.errors import StageError
from urbantwin.fidelity import compare
from urbantwin.fidelity.findings import Findings, report_of
from urbantwin.fidelity.nearest_point import PointTree, nearest_distances
from urbantwin.fidelity.pairs import Pairs, measured_pairs
from urbantwin.fidelity.sides import Side, open_side, survey
from urbantwin.processes import worker_pool


@settings(max_examples=40, deadline=None)
@given(
    st.integers(0, 10**6),
    st.integers(1, 400),
    st.integers(1, 400),
    st.sampled_from([0.0, 1e-3, 1.0, 500.0]),
    st.booleans(),
)
def test_nearest_points_are_those_of_brute_force(seed, count, other, apart, on_grid):
    # Far from each other, one inside the other, in a plane, and (on the grid) with many ties.
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(count, 3)) * [30, 30, 0.2], rng.normal(size=(other, 3)) * [10, 30, 5]
    if on_grid:
        a, b = np.round(a / 4) * 4, np.round(b / 4) * 4
    b += apart
    distance, row = PointTree(a).nearest_of(PointTree(b))
    each = cdist(a, b)
    np.testing.assert_allclose(distance, each.min(axis=1), rtol=0, atol=1e-9)
    np.testing.assert_allclose(each[np.arange(count), row], distance, rtol=0, atol=1e-9)


@pytest.mark.parametrize("shift", [0.0, 3.0, 10.0])
def test_distances_of_large_clouds_are_scipys(shift):
    rng = np.random.default_rng(3)
    # A street, its houses, and the same point many times: what a tree cannot cut.
    street = rng.uniform([-60, -60, 0], [60, 60, 0.05], (30_000, 3))
    walls = rng.uniform([-60, 20, 0], [60, 20.1, 15], (10_000, 3))
    real = np.concatenate([street, walls, np.tile(walls[:1], (500, 1))])
    other = real[rng.permutation(len(real))[:35_000]] + rng.normal(scale=0.03, size=(35_000, 3))
    other[:, 2] += shift
    found = nearest_distances(real, other)
    there, back = cKDTree(other).query(real)[0], cKDTree(real).query(other)[0]
    np.testing.assert_allclose(found.real_to_synthetic, there, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.synthetic_to_real, back, rtol=0, atol=1e-9)


def write(folder, seed, count=3, points=2000):
    folder.mkdir()
    for index in range(count):
        rng = np.random.default_rng([seed, index])
        table = rng.uniform([-20, -20, -2, 0], [20, 20, 4, 1], (points, 4))
        np.save(folder / f"{index}.npy", table.astype(np.float32))
    return folder


def found_by(workers, sides):
    found = Findings(Pairs(sides, np.zeros(3), None))
    for one in measured_pairs(found.pairs, workers):
        if one is not None:
            found.add(one)
    return found


@pytest.mark.thorough
def test_the_same_figures_whatever_the_workers(tmp_path):
    counts = {"real": 4, "synthetic": 3, "arbitrary": 3}
    sides = {}
    for seed, (name, count) in enumerate(counts.items()):
        folder = write(tmp_path / name, seed, count, 800)
        if name == "synthetic":
            (folder / "1.npy").write_bytes(b"broken")
        sides[name] = Side(name, open_side(name, folder, None), count)
        survey(sides[name], lambda: None)
    one, two = (found_by(workers, sides) for workers in (1, 2))
    assert one.indices == two.indices == [0, 2]
    texts = [json.dumps(report_of(found).as_json()) for found in (one, two)]
    assert texts[0] == texts[1]
    assert one.frames[0].arbitrary_figures is not None
    assert one.frames[0].real_figures is not None
    np.testing.assert_array_equal(one.missing.points(), two.missing.points())
    for side, mine in one.pooled.items():
        for name, counts_of in mine.items():
            np.testing.assert_array_equal(counts_of, two.pooled[side][name])


def started_by(process):
    listed = subprocess.run(
        ["ps", "-o", "pid=", "--ppid", str(process.pid)],
        check=False,
        capture_output=True,
        text=True,
    )
    return [int(word) for word in listed.stdout.split()]


@pytest.mark.thorough
def test_an_interrupted_comparison_leaves_nothing(tmp_path):
    # A script without a guard: workers must not run it again.
    script = tmp_path / "script.py"
    script.write_text(
        "import signal, time\n"
        "from pathlib import Path\n"
        "from urbantwin.fidelity import compare\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)  # if ignored\n"
        "def tell(done, what):\n"
        "    print(what, flush=True)\n"
        "    if what.startswith('compared'):\n"
        "        time.sleep(0.5)  # The interrupt comes while there is work left.\n"
        "compare(Path('real'), Path('twin'), Path('out'), arbitrary=None, workers=2,\n"
        "        progress=tell)\n"
    )
    write(tmp_path / "real", 1, 20, 500), write(tmp_path / "twin", 2, 20, 500)
    before = sorted(tmp_path.rglob("*"))
    run = subprocess.Popen(
        [sys.executable, str(script)],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(Path(urbantwin.__file__).parents[1])},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert run.stdout is not None
    while not run.stdout.readline().startswith("compared"):
        assert run.poll() is None
    workers = started_by(run)
    assert len(workers) >= 2
    os.killpg(run.pid, signal.SIGINT)  # as a terminal does: to all of them
    errors = run.communicate(timeout=60)[1]
    assert run.returncode != 0
    assert errors.count("Traceback") == 1, errors  # the script's own, none of a worker
    assert "KeyboardInterrupt" in errors
    assert sorted(tmp_path.rglob("*")) == before
    for _ in range(100):
        if not any(os.path.exists(f"/proc/{pid}") for pid in workers):  # noqa: PTH110
            break
        time.sleep(0.1)
    else:
        pytest.fail("a worker is still there")


def stop(_pairs):
    os._exit(1)


def test_workers_that_are_killed_are_said(tmp_path, monkeypatch):
    real, twin = write(tmp_path / "real", 1), write(tmp_path / "twin", 2)
    monkeypatch.setattr("urbantwin.fidelity.pairs._start", stop)
    with pytest.raises(StageError, match="fewer workers"):
        compare(real, twin, tmp_path / "out", arbitrary=None, workers=2)
    assert not (tmp_path / "out").exists()


def test_workers_calculate_with_one_thread(monkeypatch):
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    with worker_pool(1, int) as pool:
        assert pool.submit(os.getenv, "OPENBLAS_NUM_THREADS").result() == "1"
        blocked = pool.submit(signal.pthread_sigmask, signal.SIG_BLOCK, set()).result()
        assert signal.SIGINT in blocked
    assert "OPENBLAS_NUM_THREADS" not in os.environ
