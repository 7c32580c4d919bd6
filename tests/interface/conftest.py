"""A small site, and the whole line of it made by Python's functions with their defaults."""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

import urbantwin as ut

from ..reliability.small_site import make_line


@dataclass(frozen=True)
class Line:
    site: Path
    twin: ut.Twin
    motion: ut.Motion
    dataset: ut.Dataset


@pytest.fixture(scope="session")
def line(
    made_once: Callable[[str, Callable[[Path], object]], Path],
    tmp_path_factory: pytest.TempPathFactory,
) -> Line:
    """Of one making for all workers, a copy: studies write beside what they are of."""

    made = made_once("small-line", make_line)
    folder = tmp_path_factory.mktemp("interface")
    shutil.copytree(made, folder, dirs_exist_ok=True)
    run = ut.open(folder / "site" / "two-avenues")
    return Line(folder / "site" / "site.yaml", run.twin, run.motion, run.dataset)


@pytest.fixture(scope="session")
def site(line: Line) -> Path:
    return line.site
