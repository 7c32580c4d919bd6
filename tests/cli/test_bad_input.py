"""Bad input is one line that names the file and the field, exit code 2, nothing half-written."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from urbantwin.geometry import SiteFrame

from ..thorough import further

Run = Callable[..., Any]
Edit = Callable[[Path, dict[str, Any]], None]


@pytest.fixture
def site(tmp_path: Path, two_avenues: Path) -> Path:
    """A copy of the example, somewhat smaller, to be spoiled."""
    folder = tmp_path / "site"
    shutil.copytree(two_avenues, folder)
    path = folder / "site.yaml"
    text = path.read_text().replace("radius_m: 130", "radius_m: 85")
    path.write_text(f"{text}\nclosed_loop: false\n")
    return path


def missing_extract(folder: Path, fields: dict[str, Any]) -> None:
    fields["osm"]["file"] = "nowhere.osm"


def truncated_extract(folder: Path, fields: dict[str, Any]) -> None:
    path = folder / fields["osm"]["file"]
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def empty_extract(folder: Path, fields: dict[str, Any]) -> None:
    (folder / fields["osm"]["file"]).write_bytes(b"")


def extract_without_roads(folder: Path, fields: dict[str, Any]) -> None:
    path = folder / fields["osm"]["file"]
    path.write_text(path.read_text().replace('k="highway"', 'k="was:highway"'))


def extract_far_away(folder: Path, fields: dict[str, Any]) -> None:
    del fields["dem"]
    fields["anchor"] = {"latitude": 52.5, "longitude": 13.4}


def crossed_polygon(folder: Path, fields: dict[str, Any]) -> None:
    frame = SiteFrame(fields["anchor"]["latitude"], fields["anchor"]["longitude"])
    bow = [(-100, -100), (100, 100), (100, -100), (-100, 100), (-100, -100)]
    ring = frame.lonlat_from_site(bow).tolist()
    (folder / "area.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    fields["region"] = {"polygon": "area.geojson"}


def unknown_sensor(folder: Path, fields: dict[str, Any]) -> None:
    fields["rig"]["sensors"][1]["model"] = "OS1-129"


def unknown_class(folder: Path, fields: dict[str, Any]) -> None:
    fields["traffic"]["per_hour"]["tricycle"] = 3


def negative_count(folder: Path, fields: dict[str, Any]) -> None:
    fields["traffic"]["per_hour"]["car"] = -3


def narrow_dem(folder: Path, fields: dict[str, Any]) -> None:
    fields["region"]["radius_m"] = 400


def rig_in_a_building(folder: Path, fields: dict[str, Any]) -> None:
    fields["rig"]["sensors"][1] |= {"east_m": 28.0, "north_m": -65.0}


def rig_under_the_ground(folder: Path, fields: dict[str, Any]) -> None:
    fields["rig"]["sensors"][0]["height_m"] = -1.0


def rig_beside_the_site(folder: Path, fields: dict[str, Any]) -> None:
    fields["rig"]["sensors"][0]["east_m"] = 900.0


def unknown_field(folder: Path, fields: dict[str, Any]) -> None:
    fields["anchor"]["latitute"] = fields["anchor"].pop("latitude")


CASES = [
    (missing_extract, "site.yaml", "osm.file", "nowhere.osm"),
    (truncated_extract, "two-avenues.osm", "truncated", "OpenStreetMap"),
    (empty_extract, "two-avenues.osm", "empty", "OpenStreetMap"),
    (extract_without_roads, "two-avenues.osm", "no roads", "highway"),
    (extract_far_away, "two-avenues.osm", "km away", "52.5"),
    (crossed_polygon, "area.geojson", "crosses itself", "polygon"),
    (unknown_sensor, "site.yaml", "rig.sensors[1].model", "OS1-128"),
    (unknown_class, "site.yaml", "traffic.per_hour", "tricycle"),
    (negative_count, "site.yaml", "traffic.per_hour", "-3"),
    (narrow_dem, "two-avenues-dem.tif", "cover", "region"),
    (rig_in_a_building, "site.yaml", "rig.sensors[1]", "building"),
    (rig_under_the_ground, "site.yaml", "rig.sensors[0].height_m", "under the ground"),
    (rig_beside_the_site, "site.yaml", "rig.sensors[0]", "ground"),
    (unknown_field, "site.yaml", "latitute", "latitude"),
]


@pytest.mark.parametrize("command", ["build", *further("run")])
@pytest.mark.parametrize(
    ("spoil", "file", "place", "word"), CASES, ids=lambda case: getattr(case, "__name__", None)
)
def test_a_bad_site_is_told_in_one_line(
    run_here: Run,
    site: Path,
    tmp_path: Path,
    command: str,
    spoil: Edit,
    file: str,
    place: str,
    word: str,
) -> None:
    fields = yaml.safe_load(site.read_text(encoding="utf-8"))
    spoil(site.parent, fields)
    site.write_text(yaml.safe_dump(fields), encoding="utf-8")
    before = sorted(tmp_path.iterdir())
    outcome = run_here(command, site, "-o", tmp_path / "out")
    told = outcome.err.splitlines()
    assert outcome.code == 2
    assert outcome.out == ""
    assert told[-1].startswith(f"error: {site.parent / file}: ")
    assert place in told[-1]
    assert word in told[-1]
    assert "expected" in told[-1]
    assert not [line for line in told[:-1] if not line.startswith("twin: ")]
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    "text", ["", "name: [", "just words", "- a\n- b\n", "\x00\x01", "anchor: 3"]
)
def test_what_is_not_a_site_is_told_in_one_line(run_here: Run, tmp_path: Path, text: str) -> None:
    site = tmp_path / "site.yaml"
    site.write_text(text)
    outcome = run_here("run", site, "-o", tmp_path / "out")
    assert outcome.code == 2
    assert outcome.err.startswith(f"error: {site}: ")
    assert outcome.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == [site]


def test_a_missing_site_is_told_in_one_line(run_here: Run, tmp_path: Path) -> None:
    for command in ("run", "build"):
        outcome = run_here(command, tmp_path / "site.yaml", "-o", tmp_path / "out")
        assert (outcome.code, outcome.err.count("\n")) == (2, 1)
    for command in ("drive", "record"):
        folders = [tmp_path / "twin", tmp_path / "motion"][: 1 + (command == "record")]
        outcome = run_here(command, *folders, "-o", tmp_path / "out")
        assert (outcome.code, outcome.err.count("\n")) == (2, 1)
        assert outcome.err.startswith(f"error: {tmp_path / 'twin'}")
    assert not list(tmp_path.iterdir())


def test_somebody_elses_folder_is_never_replaced(run_here: Run, site: Path, tmp_path: Path) -> None:
    (tmp_path / "precious").mkdir()
    (tmp_path / "precious" / "thesis.txt").write_text("ten years")
    outcome = run_here("build", site, "-o", tmp_path / "precious")
    assert outcome.code == 2
    assert outcome.err.count("\n") == 1
    assert [path.name for path in (tmp_path / "precious").iterdir()] == ["thesis.txt"]
    assert (tmp_path / "precious" / "thesis.txt").read_text() == "ten years"


def test_init_does_not_write_over_a_site(run_here: Run, site: Path) -> None:
    before = site.read_bytes()
    outcome = run_here("init", site.parent, "--osm", site.parent / "two-avenues.osm")
    assert outcome.code == 2
    assert str(site) in outcome.err
    assert site.read_bytes() == before


@pytest.mark.parametrize(
    "extra", [("--lat", "10", "--lon", "10"), ("--radius", "-5"), ("--region", "missing.geojson")]
)
def test_a_bad_init_leaves_nothing(
    run_here: Run, two_avenues: Path, tmp_path: Path, extra: tuple[str, ...]
) -> None:
    osm = two_avenues / "two-avenues.osm"
    outcome = run_here("init", tmp_path / "new", "--osm", osm, *extra)
    assert (outcome.code, outcome.err.count("\n")) == (2, 1)
    assert not list(tmp_path.iterdir())


def test_compare_names_the_cloud_that_is_wrong(run_here: Run, tmp_path: Path) -> None:
    for name in ("real", "synthetic"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "0.npy").write_bytes(b"no numbers")
    folders = [tmp_path / "real", tmp_path / "synthetic"]
    outcome = run_here("compare", *folders, "-o", tmp_path / "report")
    assert (outcome.code, outcome.err.count("\n")) == (2, 1)
    assert outcome.err.startswith(f"error: {tmp_path / 'real' / '0.npy'}: ")
    assert not (tmp_path / "report").exists()
