"""Campaigns that are killed, interrupted or out of room: nothing is lost, and they go on."""

import json
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest
import yaml

from .small_site import Stand, bytes_of, command_line
from .test_full_disk import Disk, check_line, disk  # noqa: F401 - a fixture

#: What a campaign makes that is the same however it came about.
MADE = ("motions", "datasets", "index", "shards")


@pytest.fixture(scope="module")
def grid(stand: Stand) -> Path:
    path = stand.folder / "campaign" / "grid.yaml"
    path.parent.mkdir(exist_ok=True)
    fields = {
        "sites": {"a": str(stand.twin)},
        "seeds": [1, 2],
        "weather": {"dry": {}, "fog": {"weather": "fog", "visibility_m": 60}},
        "duration_s": 0.6,
        "shards": {"format": "webdataset", "megabytes": 1},
    }
    path.write_text(yaml.safe_dump(fields))
    return path


@pytest.fixture(scope="module")
def undisturbed(stand: Stand, grid: Path) -> Path:
    out = grid.parent / "undisturbed"
    assert stand.ran(["experiment", "run", grid, "-o", out, "--workers", "1"]) == (0, "")
    return out


def done(out: Path) -> list[str]:
    """The datasets that are noted as done."""
    journal = out / "journal" / "steps.jsonl"
    lines = journal.read_text().splitlines() if journal.is_file() else []
    rows = [json.loads(line) for line in lines if line.endswith("}")]
    return [row["cell"] for row in rows if row["cell"].startswith("datasets/")]


@pytest.mark.kills
@pytest.mark.parametrize("by", [signal.SIGKILL, signal.SIGTERM], ids=lambda one: one.name)
def test_it_goes_on_after_its_end(
    stand: Stand, grid: Path, undisturbed: Path, tmp_path: Path, by: signal.Signals
) -> None:
    out = tmp_path / "campaign"
    arguments = ["experiment", "run", grid, "-o", out, "--workers", "2"]
    run = subprocess.Popen(
        command_line(arguments), env=stand.environment(tmp_path), stderr=subprocess.PIPE, text=True
    )
    while not done(out):
        assert run.poll() is None
        time.sleep(0.01)
    run.send_signal(by)
    _, err = run.communicate()
    if by == signal.SIGTERM:
        assert (run.returncode, err) == (130, "error: interrupted\n")
    there = done(out)
    before = {name: (out / name / "dataset.json").stat().st_mtime_ns for name in there}
    assert 0 < len(before) < 4
    assert stand.ran(arguments, tmp_path) == (0, "")
    for name, was in before.items():
        assert (out / name / "dataset.json").stat().st_mtime_ns == was
    for name in MADE:
        assert bytes_of(out / name) == bytes_of(undisturbed / name)
    assert list((tmp_path / "tmp").iterdir()) == []


@pytest.mark.kills
def test_a_full_disk_is_one_line_and_it_goes_on(
    stand: Stand,
    grid: Path,
    undisturbed: Path,
    tmp_path: Path,
    disk: Disk,  # noqa: F811
) -> None:
    out = disk.folder / "campaign"
    whole_kb = sum(
        one.stat().st_blocks // 2 for one in undisturbed.rglob("*") if "datasets" in one.parts
    )
    disk.changed(f"size={int(0.7 * whole_kb)}k")
    arguments = ["experiment", "run", grid, "-o", out, "--workers", "1"]
    code, err = stand.ran(arguments, tmp_path)
    check_line(code, err, out, "room")
    there = done(out)
    assert 0 < len(there) < 4
    assert all((out / name / "dataset.json").is_file() for name in there)
    disk.changed("size=100000k")
    assert stand.ran(arguments, tmp_path) == (0, "")
    for name in MADE:
        assert bytes_of(out / name) == bytes_of(undisturbed / name)


@pytest.mark.thorough
def test_two_at_once_are_refused(stand: Stand, grid: Path, tmp_path: Path) -> None:
    out = tmp_path / "campaign"
    run = subprocess.Popen(
        command_line(["experiment", "run", grid, "-o", out, "--workers", "1"]),
        env=stand.environment(tmp_path),
    )
    while not (out / "journal").is_dir():
        assert run.poll() is None
        time.sleep(0.01)
    code, err = stand.ran(["experiment", "run", grid, "-o", out], tmp_path)
    assert code == 2
    assert f"another run is writing it (process {run.pid})" in err
    os.kill(run.pid, signal.SIGTERM)
    assert run.wait() == 130
