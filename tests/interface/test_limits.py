"""Limits of the system are said as such, with what to do, and blame no file."""

import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from urbantwin.errors import InputError, LimitError, limit_reached

from ..reliability.small_site import ROOT
from ..thorough import further
from .conftest import Line


@pytest.mark.parametrize(
    ("limit", "most", "said"),
    [
        (resource.RLIMIT_AS, 2_500_000_000, "out of memory: this process may use 2.5 GB"),
        (resource.RLIMIT_NOFILE, 16, "too many files are open: this process may open 16"),
        # While modules are imported.
        *further((resource.RLIMIT_AS, 600_000_000, "out of memory: this process may use 0.6 GB")),
    ],
)
def test_a_recording_says_which_limit_it_meets(
    line: Line, tmp_path: Path, limit: int, most: int, said: str
) -> None:
    out = tmp_path / "out"
    done = subprocess.run(
        [sys.executable, "-m", "urbantwin", "record", line.twin.folder, line.motion.folder,
         "-o", out, "--workers", "2", "--stop", "0.3", "--no-pictures", "-q"],
        preexec_fn=lambda: resource.setrlimit(limit, (most, most)),
        env={"PYTHONPATH": str(ROOT / "src"), "PATH": "/usr/bin:/bin"},
        capture_output=True, encoding="utf-8", check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert said in done.stderr
    assert "allow more" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_what_asks_for_more_than_the_machine_has_is_damaged_itself() -> None:
    with pytest.raises(MemoryError) as caught:
        np.empty(1 << 60, np.uint8)
    assert limit_reached(caught.value) is None
    assert isinstance(limit_reached(MemoryError()), LimitError)
    assert limit_reached(InputError("out of memory", file="out of memory")) is None
