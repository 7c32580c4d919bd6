"""``init --preset`` without a map: that of the preset's place is fetched, or of a place given."""

from math import cos, radians
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

from urbantwin.cli import main
from urbantwin.geometry import SiteFrame
from urbantwin.site.presets import preset

from .local_web import overpass
from .made_world import EXTRACT, LATITUDE, LONGITUDE, row

#: What the streets of the made place are called at V2X-Real's.
NAMES = {"Long Avenue": "Westwood Plaza", "Cross Street": "Charles E. Young Drive North"}


def made_place_at(latitude: float, longitude: float) -> bytes:
    """The made place with its junction elsewhere, and other names of its streets."""
    root = ElementTree.parse(EXTRACT).getroot()
    narrow = cos(radians(LATITUDE)) / cos(radians(latitude))
    for node in root.iter("node"):
        node.set("lat", f"{float(node.get('lat')) - LATITUDE + latitude:.7f}")
        node.set("lon", f"{(float(node.get('lon')) - LONGITUDE) * narrow + longitude:.7f}")
    for tag in root.iter("tag"):
        tag.set("v", NAMES.get(tag.get("v"), tag.get("v")))
    for bounds in root.findall("bounds"):
        root.remove(bounds)
    return ElementTree.tostring(root)


@pytest.fixture
def init(server, own_table, tmp_path, capsys):
    """``init(options)``: exit code, the site's document, and what is told."""

    def run(*options: str):
        table = own_table(row(server, "osm", "map", "overpass", "/api/interpreter"))
        kept = ["--sources", table, "--cache", tmp_path / "cache", "--use", "osm", "--quiet"]
        folder = tmp_path / "mysite"
        code = main([str(one) for one in ("init", folder, *options, *kept)])
        file = folder / "site.yaml"
        site = yaml.safe_load(file.read_text()) if file.exists() else None
        assert folder.exists() == (code == 0)
        return code, site, capsys.readouterr().err

    return run


def test_the_map_of_a_presets_place_is_fetched_and_tells_where_it_is(server, init):
    rough = preset("v2x-real").place
    east_north = np.array([[160.0, -210.0]])  # within the 300 m that the preset says
    lon, lat = SiteFrame(rough.latitude, rough.longitude).lonlat_from_site(east_north)[0]
    server.answers["/api/interpreter"] = overpass(made_place_at(lat, lon))
    code, site, told = init("--preset", "v2x-real")
    assert (code, told.count("warning: ")) == (0, told.count("warning: pole"))
    anchor = site["anchor"]["latitude"], site["anchor"]["longitude"]
    assert anchor == pytest.approx((lat, lon), abs=2e-5)
    assert site["region"] == {"radius_m": 120}
    assert site["osm"]["fetched"]["source"] == "osm"
    sensors = site["rig"]["sensors"]
    assert [one["model"] for one in sensors] == ["OS1-128", "OS1-64"]
    assert sensors[0]["east_m"] < 0 < sensors[0]["north_m"]
    assert sensors[1]["north_m"] < 0 < sensors[1]["east_m"]


def test_of_a_preset_without_a_place_the_one_that_is_given_is_fetched(init):
    code, site, _ = init("--preset", "dair-v2x", "--at", f"{LATITUDE},{LONGITUDE}")
    assert code == 0
    assert site["anchor"] == {"latitude": LATITUDE, "longitude": LONGITUDE}
    assert [one["model"] for one in site["rig"]["sensors"]] == ["DAIR-V2X-300"]


@pytest.mark.parametrize(
    ("options", "told", "asked"),
    [
        (["--preset", "ips300"],
         "--preset ips300: there is no street within 620 m of 39.9925,116.327: the map has nothing "
         "there; expected --osm with an extract: https://www.openstreetmap.org/export", 1),
        (["--preset", "v2x-real", "--radius", "5000"], "--radius: is 5000 m; expected 20 to", 0),
        (["--preset", "ips300", "--radius", "1900"], "--preset ips300: there is no street", 1),
        (["--preset", "lumpi", "--at", f"{LATITUDE},{LONGITUDE}"],
         "--preset lumpi: is of a place 411 km from 48.7, 9.18", 0),
        (["--preset", "lumpi", "--offline"],
         "--preset lumpi: the map cannot be fetched (osm: 127.0.0.1", 0),
    ],
)  # fmt: skip
def test_a_preset_whose_place_cannot_be_had_is_one_line(server, init, options, told, asked):
    code, _, err = init(*options)
    assert code == 2
    assert err.startswith(f"error: {told}")
    assert len(server.asked) == asked
