"""Sites with imported geometry, from site.yaml to the twin, as a person runs them."""

import gzip
import hashlib
import json
import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml

from urbantwin.geometry import SiteFrame
from urbantwin.twin import load_twin

Run = Callable[..., Any]
Write = Callable[[Path], None]
FRAME = SiteFrame(52.0117, 4.3667)
#: West, south, east, north and height of a house, metres.
HOUSE = (12.0, 14.0, 22.0, 22.0, 9.0)
HERE = {"similarity": {}}


def street_map(path: Path) -> None:
    """Write a map of one street."""
    places = FRAME.lonlat_from_site([(-90.0, 0.0), (90.0, 0.0)])
    nodes = "".join(
        f'<node id="{k}" version="1" lat="{lat}" lon="{lon}"/>'
        for k, (lon, lat) in enumerate(places, start=1)
    )
    path.write_text(
        f'<osm version="0.6">{nodes}<way id="1" version="1"><nd ref="1"/><nd ref="2"/>'
        '<tag k="highway" v="residential"/></way></osm>',
        encoding="utf-8",
    )


def place(*, turned: bool = False) -> trimesh.Trimesh:
    """A square of ground 120 m wide and a house on it; ``turned``: upside down."""
    side = np.linspace(-60.0, 60.0, 25)
    x, y = np.meshgrid(side, side, indexing="ij")
    corner = (np.arange(24)[:, None] * 25 + np.arange(24)).ravel()
    faces = np.concatenate(
        [
            np.column_stack([corner, corner + 25, corner + 26]),
            np.column_stack([corner, corner + 26, corner + 1]),
        ]
    )
    plain = trimesh.Trimesh(
        np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]), faces, process=False
    )
    west, south, east, north, height = HOUSE
    house = trimesh.creation.box((east - west, north - south, height))
    house.apply_translation([(west + east) / 2, (south + north) / 2, height / 2])
    whole = trimesh.util.concatenate([plain, house])
    if turned:
        whole.apply_transform(trimesh.transformations.rotation_matrix(np.pi, [1, 0, 0]))
    return whole


def obj(**how: bool) -> Write:
    return lambda folder: place(**how).export(folder / "a.obj")


def lines(name: str, text: str) -> Write:
    return lambda folder: (folder / name).write_text(text)


def tileset(folder: Path, uri: str) -> None:
    lon, lat = np.radians([FRAME.longitude, FRAME.latitude])
    region = [lon - 2e-5, lat - 2e-5, lon + 2e-5, lat + 2e-5, -100.0, 200.0]
    root = {"boundingVolume": {"region": region}, "geometricError": 0, "content": {"uri": uri}}
    folder.mkdir(exist_ok=True)
    (folder / "tileset.json").write_text(
        json.dumps({"asset": {"version": "1.0"}, "geometricError": 9, "root": root})
    )


def bomb(folder: Path) -> None:
    tileset(folder / "t", "a.b3dm")
    (folder / "t" / "a.b3dm").write_bytes(gzip.compress(bytes(1 << 29), 1))


def nan_stl(folder: Path) -> None:
    data = bytearray(place().export(file_type="stl"))
    struct.pack_into("<f", data, 84 + 12, float("nan"))
    (folder / "a.stl").write_bytes(data)


def cut_laz(folder: Path, shared: Path) -> None:
    survey = shared / "airborne" / "delft-ahn3" / "ahn3" / "ahn3_cropped_2.laz"
    (folder / "a.laz").write_bytes(survey.read_bytes()[:5000])


def write_site(folder: Path, sources: list[dict[str, Any]]) -> Path:
    street_map(folder / "map.osm")
    sensor = {"name": "a", "model": "OS1-128", "east_m": 0, "north_m": -8, "height_m": 5}
    fields = {
        "name": "imported",
        "anchor": {"latitude": FRAME.latitude, "longitude": FRAME.longitude},
        "region": {"radius_m": 40},
        "osm": "map.osm",
        "geometry": sources,
        "rig": {"sensors": [sensor]},
    }
    (folder / "site.yaml").write_text(yaml.safe_dump(fields))
    return folder / "site.yaml"


def refused(run: Run, folder: Path, source: dict[str, Any]) -> str:
    """Return the one line of a build that is refused, and that leaves nothing behind."""
    site = write_site(folder, [source])
    before = sorted(path.name for path in folder.iterdir())
    outcome = run("build", site, "-o", folder / "twin", "--no-pictures", "--quiet")
    assert outcome.code == 2
    assert outcome.out == ""
    assert outcome.err.startswith("error: ")
    assert outcome.err.count("\n") == 1
    assert sorted(path.name for path in folder.iterdir()) == before
    return str(outcome.err)


ONE_LINE = "v 0 0 1\nv 5 0 1\nv 10 0 1\nf 1 2 3\n"


@pytest.mark.parametrize(
    ("write", "source", "said"),
    [
        (nan_stl, {"file": "a.stl"} | HERE, "nan, infinite or beyond"),
        (bomb, {"file": "t/tileset.json"}, "unpacks to more than"),
        (lambda f: tileset(f / "t", "../b.b3dm"), {"file": "t"}, "leads out of the tileset's"),
        (lambda f: tileset(f / "t", "tileset.json"), {"file": "t"}, "contains itself"),
        (obj(), {"file": "a.obj", "crs": "EPSG:999999"}, "PROJ does not know"),
        (obj(), {"file": "a.obj", "crs": "EPSG:28992"}, "km from the site's region"),
        (obj(), {"file": "a.obj"}, "does not say where it is"),
        (obj(), {"file": "a.obj", "unit": "mm"} | HERE, "120 mm wide"),
        (obj(), {"file": "a.obj", "provides": []} | HERE, "provides (line"),
        (obj(), {"file": "a.obj", "unit": "parsec"} | HERE, "geometry[0].unit (line"),
        (obj(), {"file": "a.obj", "control_points": []}, "control_points (line"),
        (obj(turned=True), {"file": "a.obj"} | HERE, "is upside down"),
        (lines("a.obj", ONE_LINE), {"file": "a.obj"} | HERE, "no triangle with an area"),
        (lines("a.dwg", "AC1032"), {"file": "a.dwg"}, "holds nothing known"),
        (lines("a.obj", ""), {"file": "a.obj"} | HERE, "is empty"),
        (lambda f: None, {"url": "http://127.0.0.1:9/x/a.json"}, "http://127.0.0.1:9/x/a.json"),
    ],
)
def test_a_bad_source_is_one_line_and_leaves_nothing(
    run_here: Run,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    write: Write,
    source: dict[str, Any],
    said: str,
) -> None:
    monkeypatch.setattr("urbantwin.download.client.PAUSE_S", 0.0)
    write(tmp_path)
    assert said in refused(run_here, tmp_path, source)


def test_a_survey_cut_short_is_one_line(run_here: Run, tmp_path: Path, shared_data: Path) -> None:
    cut_laz(tmp_path, shared_data)
    assert "cannot be read as LAS or LAZ" in refused(
        run_here, tmp_path, {"file": "a.laz", "crs": "EPSG:7415"}
    )


def test_a_wrong_point_of_control_is_named_by_its_place(run_here: Run, tmp_path: Path) -> None:
    obj()(tmp_path)
    points = [
        {"model": [0.0, 0.0, 0.0], "site_m": [0.0, 0.0, 0.0]},
        {"model": [0.0, 9.0, float("nan")], "site_m": [0.0, 9.0, 0.0]},
    ]
    said = refused(run_here, tmp_path, {"file": "a.obj", "control_points": points})
    assert "geometry[0].control_points[1].model[2]" in said
    assert "is nan" in said


def building_of(folder: Path) -> trimesh.Trimesh:
    mesh = load_twin(folder).mesh
    from urbantwin.taxonomy import semantic_id

    return trimesh.Trimesh(
        mesh.vertices, mesh.faces[mesh.semantic == semantic_id("building")], process=False
    )


@pytest.mark.thorough
def test_a_model_in_centimetres_with_y_up_stands_where_it_should_and_builds_the_same_twice(
    run_here: Run, tmp_path: Path
) -> None:
    model = place()
    model.apply_scale(100.0)
    model.vertices = np.column_stack(
        [model.vertices[:, 0], model.vertices[:, 2], -model.vertices[:, 1]]
    )
    model.export(tmp_path / "a.obj")
    origin = {"latitude": FRAME.latitude, "longitude": FRAME.longitude}
    site = write_site(tmp_path, [{"file": "a.obj", "origin": origin}])
    sums = []
    for name in ("one", "two"):
        done = run_here("build", site, "-o", tmp_path / name, "--no-pictures", "--quiet")
        assert done.code == 0, done.err
        files = sorted(p for p in (tmp_path / name).rglob("*") if p.is_file())
        sums.append({p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in files})
    assert sums[0] == sums[1]
    west, south, east, north, height = HOUSE
    used = building_of(tmp_path / "one").triangles.reshape(-1, 3)
    assert used.min(axis=0) == pytest.approx([west, south, 0.0], abs=0.05)
    assert used.max(axis=0) == pytest.approx([east, north, height], abs=0.05)
    placed = json.loads((tmp_path / "one" / "geometry.json").read_text())["sources"][0]["placed"]
    assert (placed["up"], placed["unit_m"]) == ("y", 0.01)


def test_overrides_and_what_is_provided_are_heeded(run_here: Run, tmp_path: Path) -> None:
    obj()(tmp_path)
    here = [(HOUSE[0] + HOUSE[2]) / 2, (HOUSE[1] + HOUSE[3]) / 2]
    clean = {"remove": [{"at_m": here, "radius_m": 6.0}], "keep": [{"at_m": [500.0, 0.0]}]}
    for name, more, houses in (
        ("without", {"clean": clean}, 0),
        ("ground", {"provides": ["ground"]}, 0),
        ("buildings", {"provides": ["buildings"]}, 1),
    ):
        site = write_site(tmp_path, [{"file": "a.obj"} | HERE | more])
        done = run_here("build", site, "-o", tmp_path / name, "--no-pictures")
        assert done.code == 0, done.err
        assert (len(building_of(tmp_path / name).faces) > 0) == bool(houses)
        ground = done.out.split("notes:")[1].split("  roads:")[0]
        assert ("a.obj" in ground) == (name != "buildings")  # whose ground
        if name == "without":
            assert "nothing to keep within 3 m of (500.0, 0.0)" in done.out
        shutil.rmtree(tmp_path / name)
