"""From two numbers to a twin: fetched from servers of this machine, then built."""

import json
import re

import numpy as np
import pytest

from urbantwin.acquire import Area
from urbantwin.cli import main
from urbantwin.ground import Elevation

from .made_world import LATITUDE, LONGITUDE, height, row


def test_a_place_becomes_a_twin_with_its_heights_buildings_and_terms(server, own_table, tmp_path):
    index = {"url": f"{server.url}/stac/catalog.json", "kind": "overture"}
    table = own_table(
        row(server, "osm", "map", "overpass", "/api/interpreter"),
        row(server, "names", "names", "nominatim", "/search"),
        row(server, "dem", "elevation", "cog", "/dem/N48E009.tif", crs="EPSG:4326+3855"),
        row(server, "overture", "buildings", "geoparquet", index=index),
    )
    site = tmp_path / "mysite"
    options = ["--radius", "45", "--sources", table, "--cache", tmp_path / "cache"]
    place = ["--place", "Long Avenue and Cross Street, Stuttgart"]
    use = ["--use", "osm,names,dem,overture", "--quiet"]
    assert main([str(one) for one in ("init", site, *place, *options, *use)]) == 0
    text = (site / "site.yaml").read_text()
    assert text.count("fetched:") == 3
    # Outer roads take most of a build's time, and are no matter here.
    (site / "site.yaml").write_text(text.replace("closed_loop: true", "closed_loop: false"))
    twin = tmp_path / "twin"
    assert main(["build", str(site), "-o", str(twin), "--no-pictures", "--quiet"]) == 0

    told = json.loads((twin / "twin.json").read_text())
    assert [(one["kind"], one["licence"], one["attribution"]) for one in told["inputs"]] == [
        ("osm", "licence of osm", "makers of osm"),
        ("dem", "licence of dem", "makers of dem"),
        ("buildings", "licence of overture", "makers of overture"),
    ]
    noted = re.findall(r"sha256: ([0-9a-f]{64})", text)
    assert [one["sha256"] for one in told["inputs"]] == noted
    assert told["notes"]["buildings_file"]["footprints"] >= 2
    area = Area.checked(told["anchor"]["latitude"], told["anchor"]["longitude"], 40.0)
    assert (area.latitude, area.longitude) == pytest.approx((LATITUDE, LONGITUDE), abs=2e-4)
    grid = Elevation.load(twin / "elevation.npz")
    points = np.array([[x, y] for x in (-35.0, 0.0, 35.0) for y in (-35.0, 0.0, 35.0)])
    expected = height(*area.frame.lonlat_from_site(points).T)
    expected -= height(area.longitude, area.latitude)
    assert grid.raw_at(points) == pytest.approx(expected, abs=0.1)
