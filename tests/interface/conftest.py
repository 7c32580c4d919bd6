"""A small site, and the whole line of it made by Python's functions with their defaults."""

from dataclasses import dataclass
from pathlib import Path

import pytest

import urbantwin as ut

from ..reliability.small_site import Stand


@dataclass(frozen=True)
class Line:
    site: Path
    twin: ut.Twin
    motion: ut.Motion
    dataset: ut.Dataset


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Stand(tmp_path_factory.mktemp("interface")).site


@pytest.fixture(scope="session")
def line(site: Path) -> Line:
    twin = ut.build(site, pictures=False, progress=False)
    motion = ut.drive(twin, progress=False)
    dataset = ut.record(twin, motion, stop=0.5, workers=1, pictures=False, progress=False)
    return Line(site, twin, motion, dataset)
