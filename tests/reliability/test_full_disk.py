"""Disks that are full, small or read-only: one line that says what to do, and nothing lost."""

import os
import resource
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from ..thorough import further
from .kill_harness import ENDINGS
from .small_site import COMMANDS, Stand, bytes_of, command_line

#: Kilobytes that each command is given: too few to end, and for `record` too few for all frames.
TOO_SMALL_KB = {
    "record": 3900,
    "build": 700,
    "traffic": 700,
    "compare": 400,
    "tune": 8,
    "place": 60,
    "background": 24,
    "export": 1500,
    "card": 4,
    "check": 100,
    "view": 500,
    "sequence": 60,
    "split": 12,
    "export-nuscenes": 400,
    "export-mcap": 400,
}


class Disk:
    """A small file system in memory."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir()

    def mounted(self, kilobytes: int, *options: str) -> bool:
        given = ["-o", ",".join([f"size={kilobytes}k", *options])]
        done = subprocess.run(
            ["mount", "-t", "tmpfs", *given, "tmpfs", self.folder], check=False, capture_output=True
        )
        return done.returncode == 0

    def changed(self, *options: str) -> None:
        subprocess.run(["mount", "-o", ",".join(["remount", *options]), self.folder], check=True)

    def free(self) -> None:
        subprocess.run(["umount", self.folder], check=False, capture_output=True)


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Disk]:
    made = Disk(tmp_path / "disk")
    if not made.mounted(100_000):
        pytest.skip("no file system may be mounted here: the limit on a file's size is tested")
    yield made
    made.free()


def check_line(code: int, err: str, out: Path, *words: str) -> None:
    assert code in (1, 2), err
    lines = err.splitlines()
    assert len(lines) == 1, err
    assert lines[0].startswith(f"error: {out}"), lines[0]
    assert all(word in lines[0] for word in words), lines[0]


def check_full(stand: Stand, place: Path, disk: Disk, key: str, *, older: bool) -> None:
    command = COMMANDS[key]
    older = older or command.in_place
    out = disk.folder / command.output
    expected = stand.expected(key)
    used_kb = 0
    if older:
        former = stand.older(command.output)
        (shutil.copytree if former.is_dir() else shutil.copyfile)(former, out)
        status = os.statvfs(disk.folder)
        used_kb = (status.f_blocks - status.f_bfree) * status.f_frsize // 1024
    before = bytes_of(out) if older else {}
    disk.changed(f"size={used_kb + TOO_SMALL_KB[key]}k")
    arguments = command.arguments(stand, out)
    if key == "record":  # what it needs at least fits; what it needs does not
        arguments += ["--workers", "1"]
    code, err = stand.ran(arguments, place)
    check_line(code, err, out, "no room left", "make room and give the same command again")
    assert (bytes_of(out) if older else {}) == before
    hidden = [one for one in disk.folder.iterdir() if one != out]
    assert all(one.name.endswith(ENDINGS[1]) for one in hidden)
    assert command.resumes or not hidden
    frames = {}
    if key == "record":
        assert "it goes on from what was made" in err
        (partial,) = hidden
        marks = [one.stem for one in (partial / "done").glob("*.json")]
        assert 0 < len(marks) < 20
        frames = {name: (partial / "points" / f"{name}.npy").stat() for name in marks}
    disk.changed("size=100000k")
    assert stand.ran(arguments, place) == (0, "")
    assert bytes_of(out) == bytes_of(expected)
    assert list(disk.folder.iterdir()) == [out]
    assert list((place / "tmp").iterdir()) == []
    for name, was in frames.items():  # not recorded again
        now = (out / "points" / f"{name}.npy").stat()
        assert (now.st_ino, now.st_mtime_ns) == (was.st_ino, was.st_mtime_ns)


@pytest.mark.kills
@pytest.mark.parametrize("older", [False, True], ids=["new", "older"])
@pytest.mark.parametrize("key", TOO_SMALL_KB)
def test_a_full_disk(stand: Stand, tmp_path: Path, disk: Disk, key: str, older: bool) -> None:
    check_full(stand, tmp_path, disk, key, older=older)


@pytest.mark.thorough
@pytest.mark.parametrize("key", ["record"])
def test_a_full_disk_of_few(stand: Stand, tmp_path: Path, disk: Disk, key: str) -> None:
    check_full(stand, tmp_path, disk, key, older=False)


@pytest.mark.thorough
@pytest.mark.parametrize("key", ["traffic", *further("export")])
def test_a_limit_on_the_size_of_files(stand: Stand, tmp_path: Path, key: str) -> None:
    command = COMMANDS[key]
    out = tmp_path / "out" / command.output
    done = subprocess.run(
        command_line(command.arguments(stand, out)),
        env=stand.environment(tmp_path),
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (100 * 1024, 100 * 1024)),
    )
    check_line(done.returncode, done.stderr, out, "files may not be so large here (ulimit -f)")
    assert not out.parent.exists()
    assert list((tmp_path / "tmp").iterdir()) == []


def test_frames_that_will_not_fit_are_refused_at_once(
    stand: Stand, tmp_path: Path, disk: Disk
) -> None:
    out = disk.folder / "dataset"
    arguments = COMMANDS["record"].arguments(stand, out)
    disk.changed("size=200k")
    code, err = stand.ran(arguments, tmp_path)
    check_line(code, err, out, "a dataset of 20 frames needs about", "are free on the disk")
    assert code == 2
    assert list(disk.folder.iterdir()) == []


def test_a_read_only_disk_is_refused_before_the_work(
    stand: Stand, tmp_path: Path, disk: Disk
) -> None:
    expected = dict.fromkeys(("traffic", "export", "check"), stand.twin)
    disk.changed("ro")
    for key in expected:
        out = disk.folder / COMMANDS[key].output
        code, err = stand.ran(COMMANDS[key].arguments(stand, out), tmp_path)
        check_line(code, err, out, "cannot be written (read-only file system)")
        assert code == 2
    disk.changed("rw")
