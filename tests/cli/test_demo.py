"""The demo's place, and what is said where its map is missing."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import osmium
import pytest

import urbantwin
from urbantwin.geometry import SiteFrame
from urbantwin.interface.whole_line import LATITUDE, LONGITUDE, helsinki_extract
from urbantwin.twin import load_twin

Run = Callable[..., Any]


@pytest.mark.thorough
def test_the_place_has_mapped_signals_and_the_twin_has_them_too(
    run_here: Run, tmp_path: Path
) -> None:
    """In the middle of the place: the streets around it are not built, nor closed to a loop."""
    lights = osmium.FileProcessor(str(helsinki_extract()), osmium.osm.NODE).with_filter(
        osmium.filter.TagFilter(("highway", "traffic_signals"))
    )
    mapped = [(node.location.lon, node.location.lat) for node in lights]
    away = np.linalg.norm(SiteFrame(LATITUDE, LONGITUDE).site_from_lonlat(mapped), axis=1)
    assert (away < 40.0).sum() >= 3

    place = ("--lat", LATITUDE, "--lon", LONGITUDE, "--radius", 60)
    assert run_here("init", tmp_path / "site", "--osm", helsinki_extract(), *place).code == 0
    site = tmp_path / "site" / "site.yaml"
    site.write_text(site.read_text().replace("closed_loop: true", "closed_loop: false"))
    assert run_here("build", site, "-o", tmp_path / "twin", "--no-pictures").code == 0
    signals = load_twin(tmp_path / "twin").roads.signals
    places = np.array([(signal.x, signal.y) for signal in signals])
    assert (np.linalg.norm(places, axis=1) < 50.0).sum() >= 3


def test_the_map_says_whose_it_is() -> None:
    attribution = helsinki_extract().with_name("ATTRIBUTION.md").read_text()
    assert "© OpenStreetMap contributors" in attribution
    assert "Open Database License" in attribution


def test_a_missing_map_is_one_line(tmp_path: Path) -> None:
    """A copy of the package without the map, as in a checkout where nothing was made."""
    package = tmp_path / "src" / "urbantwin"
    shutil.copytree(
        Path(urbantwin.__file__).parent, package, ignore=shutil.ignore_patterns("*.pbf", "page")
    )
    outcome = subprocess.run(
        [sys.executable, "-m", "urbantwin", "demo", "-o", tmp_path / "demo"],
        env={**os.environ, "PYTHONPATH": str(package.parent)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert outcome.returncode == 2
    assert outcome.stderr == (
        "error: demo: the map of Helsinki is not made in this checkout; expected"
        " first: python hatch_build.py\n"
    )
    assert not (tmp_path / "demo").exists()
