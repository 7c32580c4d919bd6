"""Every change of the disk while an output is written is a moment to be killed at."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from urbantwin.artefact.written_files import RECORD

from ..thorough import further
from .kill_harness import ENDINGS, check_inventory
from .small_site import ROOT, bytes_of

PROGRAM = Path(__file__).with_name("swap_program.py")
#: More than there are changes.
MOST = 70


def contents(number: int) -> dict[str, str]:
    names = {name: f"{name} {number}" for name in ("deep/a", "b", "c")}
    return names | ({"d": "more"} if number == 2 else {})


@pytest.mark.parametrize(
    ("kind", "exchange", "older"),
    [
        ("folder", "exchange", "older"),
        ("folder", "no exchange", "older"),
        ("resumed", "exchange", "older"),
        ("file", "exchange", "older"),
        *further(("resumed", "no exchange", "older"), ("file", "no exchange", "older")),
        # With nothing to exchange.
        *further(*((kind, "exchange", "none") for kind in ("folder", "resumed", "file"))),
    ],
)
def test_at_every_change_one_of_the_two_is_whole(
    tmp_path: Path, kind: str, exchange: str, older: str
) -> None:
    done = subprocess.run(
        [sys.executable, PROGRAM, tmp_path, kind, exchange, older, "1", str(MOST)],
        env=os.environ | {"PYTHONPATH": str(ROOT / "src")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    ends = [line.split()[1] for line in done.stdout.splitlines()]
    assert ends.count("killed") > 5
    assert ends[-1] == "ended", "more changes than were tried"
    for n, end in enumerate(ends, start=1):
        name = "scene.obj" if kind == "file" else "twin"
        left, after = tmp_path / f"{n} left", tmp_path / str(n)
        if kind == "file":
            check_file(left, after, older=older == "older", ended=end == "ended")
        else:
            check_folder(left, after, exchange == "exchange", older == "older", end == "ended")
        hidden = {one.name for one in left.iterdir() if one.name.startswith(".")} - {RECORD}
        assert all(one.endswith(ENDINGS) for one in hidden)
        assert not {one.name for one in after.iterdir() if one.name.startswith(".")} - {RECORD}
        assert (after / name).exists()


def check_folder(left: Path, after: Path, exchange: bool, older: bool, ended: bool) -> None:
    found = left / "twin"
    aside = list(left.glob(".twin.*.urbantwin-old"))
    if not found.exists() and not exchange and aside:
        found = aside[0]  # in the one moment between two names
    if found.exists():
        number = next(n for n in (1, 2) if (found / "b").read_text() == f"b {n}")
        assert number == 1 or not ended
        for name, text in contents(number).items():
            assert (found / name).read_text() == text
        assert set(bytes_of(found)) == {*contents(number), "twin.json", "SHA256SUMS"}
        check_inventory(found)
    else:
        assert not older
        assert not ended
    assert set(bytes_of(after / "twin")) == {*contents(1), "twin.json", "SHA256SUMS"}
    for name, text in contents(1).items():
        assert (after / "twin" / name).read_text() == text
    check_inventory(after / "twin")


def check_file(left: Path, after: Path, *, older: bool, ended: bool) -> None:
    if (left / "scene.obj").exists():
        text = (left / "scene.obj").read_text()
        assert text in (["shape 1", "shape 2"] if older and not ended else ["shape 1"])
    else:
        assert not older
    assert (after / "scene.obj").read_text() == "shape 1"
    assert (after / "scene.mtl").read_text() == "colours 1"
    assert {one.name for one in after.iterdir()} == {"scene.obj", "scene.mtl", RECORD}
