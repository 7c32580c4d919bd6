"""What is said of geometry before there is a site, against what the test put there."""

import json

import numpy as np
import pytest
import trimesh

from urbantwin.errors import InputError
from urbantwin.interface.inspection import summary_of as summary
from urbantwin.reconstruct.describe import describe_geometry


def house() -> trimesh.Trimesh:
    return trimesh.creation.box((12.0, 8.0, 20.0))


@pytest.mark.parametrize("ending", ["glb", "obj", "ply", "stl"])
def test_meshes_of_every_ending(tmp_path, ending):
    house().export(tmp_path / f"a.{ending}")
    said = summary(tmp_path / f"a.{ending}")
    assert said["kind"] == "geometry"
    assert said["triangles"] == 12
    assert said["lowest"] == [-6.0, -4.0, -10.0]
    assert said["highest"] == [6.0, 4.0, 10.0]
    assert said["crs"] == "not said"
    assert said["problems"] == []
    assert json.loads(json.dumps(said)) == said


def test_a_ply_of_points_is_still_a_cloud(tmp_path):
    points = trimesh.PointCloud(np.random.default_rng(1).uniform(0, 9, (50, 3)))
    points.export(tmp_path / "a.ply")
    said = summary(tmp_path / "a.ply")
    assert (said["kind"], said["points"]) == ("cloud", 50)


@pytest.mark.thorough
def test_a_survey_and_a_city_model_of_delft(shared_data):
    folder = shared_data / "airborne" / "delft-ahn3"
    survey = describe_geometry(folder / "ahn3" / "ahn3_cropped_2.laz")
    assert survey["points"] == 208_432  # of its header
    assert sum(survey["points_by_class"].values()) == survey["points"]
    city = describe_geometry(folder / "reference" / "testarea.json")
    assert "Amersfoort / RD New" in city["crs"]
    # Delft, by any atlas.
    assert city["latitude"] == pytest.approx(52.01, abs=0.01)
    assert city["longitude"] == pytest.approx(4.36, abs=0.02)


def test_tiles_with_what_is_missing(shared_data):
    folder = shared_data / "tiles3d" / "1.0" / "TilesetWithRequestVolume"
    said = summary(folder / "tileset.json")
    assert said["triangles"] == 480
    assert any("not found" in line for line in said["problems"])
    document = json.loads((folder / "city" / "tileset.json").read_text())
    west, south, east, north = np.degrees(document["root"]["boundingVolume"]["region"][:4])
    assert west < said["longitude"] < east
    assert south < said["latitude"] < north
    assert summary(folder)["triangles"] == said["triangles"]


def test_what_cannot_be_read_is_one_line(tmp_path):
    (tmp_path / "a.glb").write_bytes(b"glTF\x02\x00\x00\x00")
    with pytest.raises(InputError) as caught:
        summary(tmp_path / "a.glb")
    assert "\n" not in str(caught.value)
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="nothing that UrbanTwin knows"):
        summary(tmp_path / "empty")
