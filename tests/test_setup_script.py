"""What `make` finds out about the machine before it installs anything."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from .source_imports import ROOT

SETUP = ROOT / "tools" / "setup.sh"


def setup(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [SETUP, *arguments], capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHON": "", **environment},
    )  # fmt: skip


def stand_in(folder: Path, name: str, script: str) -> None:
    """Write a program that stands in for another of that name on the path."""
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(f"#!/bin/sh\n{script}\n")
    (folder / name).chmod(0o755)


def test_a_python_that_suits_is_found_among_others(tmp_path: Path) -> None:
    """Where `python3` is too old and `python3.13` is not there, the next one is taken."""
    stand_in(tmp_path / "bin", "python3", "exit 1")
    stand_in(tmp_path / "bin", "python3.13", "exit 127")
    stand_in(tmp_path / "bin", "python3.12", f'exec "{sys.executable}" "$@"')
    found = setup("python", PATH=f"{tmp_path / 'bin'}:{os.environ['PATH']}")
    assert found.stdout == f"{tmp_path / 'bin' / 'python3.12'}\n"


@pytest.mark.parametrize("target", ["python", "demo", "test"])
def test_a_python_that_does_not_suit_is_refused_in_one_line(tmp_path: Path, target: str) -> None:
    stand_in(tmp_path, "snake", '[ "$1" = --version ] && exec echo Python 3.10.2; exit 1')
    for python, said in ((tmp_path / "snake", "Python 3.10.2"), (tmp_path / "gone", "not here")):
        done = setup(target, PYTHON=str(python))
        assert done.returncode == 1
        assert done.stderr.count("\n") == 1
        assert f"needs Python 3.11 to 3.13, and {python} is {said}" in done.stderr
        assert not done.stdout


def test_a_user_without_root_learns_what_to_type(tmp_path: Path) -> None:
    """On a Debian where the dynamic loader finds no library, and `sudo` asks for a password."""
    path = tmp_path / "bin"
    stand_in(path, "python3", '[ "$1" = -c ] && exit 0; echo libgl1 python3.12-venv')
    stand_in(path, "id", "echo 1000")
    stand_in(path, "sudo", "exit 1")
    stand_in(path, "apt-get", f"touch '{tmp_path / 'installed'}'")
    stand_in(path, "apt-cache", "echo '  Candidate: 1.2'")
    stand_in(path, "chromium", "exit 1")
    stand_in(path, "chromium-browser", "exit 1")
    stand_in(path, "google-chrome", "exit 1")
    search = f"{path}:{os.environ['PATH']}"
    for target, packages in (("demo", ""), ("test", " chromium")):
        done = setup(target, PATH=search)
        assert done.returncode == 1
        assert done.stderr == (
            "error: Debian packages are missing; type: sudo apt-get install "
            f"--no-install-recommends libgl1 python3.12-venv{packages}\n"
        )
    assert not (tmp_path / "installed").exists()
    # Chromium alone is no reason to stop: the tests that drive it skip.
    stand_in(path, "python3", "exit 0")
    done = setup("test", PATH=search)
    assert done.returncode == 0
    assert "the tests that drive a browser will skip" in done.stderr
    assert "apt-get install --no-install-recommends chromium" in done.stderr
