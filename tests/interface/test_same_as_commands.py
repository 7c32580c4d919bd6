"""The commands and the functions: the same places, the same bytes."""

from collections.abc import Callable
from pathlib import Path

import pytest

import urbantwin as ut
from urbantwin.cli import main

from ..reliability.small_site import bytes_of
from .conftest import Line


def test_what_nobody_placed_lies_beside_what_it_is_made_from(line: Line) -> None:
    folder = line.site.parent / "two-avenues"
    assert line.twin.folder == folder / "twin"
    assert line.motion.folder == folder / "motion"
    assert line.dataset.folder == folder / "dataset"
    assert {path.name for path in folder.iterdir()} == {"twin", "motion", "dataset"}


@pytest.mark.parametrize(
    ("kind", "arguments"),
    [
        ("twin", lambda line: ["build", line.site, "--no-pictures"]),
        ("motion", lambda line: ["drive", line.twin.folder]),
        (
            "dataset",
            lambda line: (
                ["record", line.twin.folder, line.motion.folder, "--stop", 0.5]
                + ["--workers", 1, "--no-pictures"]
            ),
        ),
    ],
)
def test_a_command_writes_the_bytes_that_python_writes(
    line: Line, tmp_path: Path, kind: str, arguments: Callable[[Line], list[object]]
) -> None:
    out = tmp_path / kind
    assert main([*map(str, arguments(line)), "-o", str(out), "--quiet"]) == 0
    assert bytes_of(out) == bytes_of(getattr(line, kind).folder)


def test_a_twin_of_a_folder_is_a_twin_at_hand(line: Line, tmp_path: Path) -> None:
    coverages = [
        ut.rig.coverage(twin, tmp_path / name, cell=2.0, pictures=False, progress=False)
        for name, twin in (("folder", line.twin.folder), ("hand", line.twin))
    ]
    assert bytes_of(coverages[0].folder) == bytes_of(coverages[1].folder)
    assert coverages[0].summary()["street_m2"] > 0


def test_the_seed_is_the_sites_where_nobody_gives_one(line: Line) -> None:
    assert line.dataset.manifest["seeds"]["record"] == line.twin.site["traffic"]["seed"] == 1
