import copy
import json

import numpy as np
import pytest

from urbantwin.errors import InputError
from urbantwin.taxonomy import semantic_id

from ..reconstruct.model_files import BOX, BOX_QUADS, area, read, volume


def city(**changes):
    shell = [[quad.tolist()] for quad in BOX_QUADS]
    document = {
        "type": "CityJSON",
        "version": "2.0",
        "transform": {"scale": [0.001, 0.001, 0.001], "translate": [1000.0, 2000.0, 10.0]},
        "metadata": {"referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/7415"},
        "CityObjects": {
            "b1": {
                "type": "Building",
                "geometry": [
                    {
                        "type": "Solid",
                        "lod": "2.2",
                        "boundaries": [shell],
                        "semantics": {
                            "surfaces": [{"type": "WallSurface"}, {"type": "RoofSurface"}],
                            "values": [[0, 0, 0, 0, None, 1]],
                        },
                    },
                    {"type": "MultiSurface", "lod": "1", "boundaries": shell},
                ],
            }
        },
        "vertices": (BOX * 1000).astype(int).tolist(),
    }
    return document | changes


def written(path, document):
    path.write_text(json.dumps(document))
    return path


def test_the_finest_solid_with_its_semantics_and_system(tmp_path):
    model = read(written(tmp_path / "a.city.json", city()))
    mesh = model.mesh
    assert model.crs.to_epsg() == 7415
    assert model.crs.is_compound  # with its vertical part
    assert volume(mesh) == pytest.approx(24.0)
    assert np.allclose(mesh.vertices.min(axis=0), [1000, 2000, 10])
    assert set(mesh.names) == {
        "Building b1 / WallSurface",
        "Building b1 / RoofSurface",
        "Building b1",
    }
    roof = mesh.object == mesh.names.index("Building b1 / RoofSurface")
    assert np.allclose(mesh.triangles()[roof][:, :, 2], 14.0)
    assert (mesh.semantic == semantic_id("building")).all()


def test_a_hole_is_left_open(tmp_path):
    document = city()
    outer, inner = [[0, 0], [10, 0], [10, 10], [0, 10]], [[2, 2], [2, 4], [5, 4], [5, 2]]
    document["vertices"] = [[1000 * x, 500 * y, 866 * y] for x, y in outer + inner]
    document["CityObjects"]["b1"]["geometry"] = [
        {"type": "MultiSurface", "lod": "2", "boundaries": [[[0, 1, 2, 3], [4, 5, 6, 7]]]}
    ]
    mesh = read(written(tmp_path / "a.json", document)).mesh
    slope = np.hypot(0.5, 0.866)
    assert area(mesh) == pytest.approx((100 - 6) * slope, rel=1e-9)


def test_templates_stand_turned_and_scaled_at_their_points(tmp_path):
    document = city()
    document["geometry-templates"] = {
        "templates": [
            {"type": "Solid", "lod": "2", "boundaries": [[[q.tolist()] for q in BOX_QUADS]]}
        ],
        "vertices-templates": BOX.tolist(),
    }
    turn = [0, -2, 0, 0, 2, 0, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1]
    document["CityObjects"] = {
        "t": {
            "type": "SolitaryVegetationObject",
            "geometry": [
                {
                    "type": "GeometryInstance",
                    "template": 0,
                    "boundaries": [7],
                    "transformationMatrix": turn,
                }
            ],
        }
    }
    mesh = read(written(tmp_path / "a.json", document)).mesh
    assert volume(mesh) == pytest.approx(8 * 24.0)
    # (2, 3, 4) of the transform, then y of the template towards -x.
    assert np.allclose(mesh.vertices.min(axis=0), [1002 - 6, 2003, 14])
    assert (mesh.semantic == semantic_id("vegetation")).all()


def test_parts_are_not_built_twice_and_materials_colour(tmp_path):
    document = city()
    whole = document["CityObjects"]["b1"]
    part = copy.deepcopy(whole) | {"type": "BuildingPart", "parents": ["b1"]}
    part["geometry"][0]["material"] = {"day": {"value": 1}}
    document["appearance"] = {"materials": [{"name": "a"}, {"diffuseColor": [1.0, 0.5, 0.0]}]}
    whole["children"] = ["p1"]
    document["CityObjects"]["p1"] = part
    mesh = read(written(tmp_path / "a.json", document)).mesh
    assert volume(mesh) == pytest.approx(24.0)
    assert (mesh.colour == [255, 128, 0]).all()


def test_a_sequence_of_features(tmp_path):
    head = city(CityObjects={}, vertices=[])
    lines = [head]
    for number in range(3):
        vertices = (BOX * 1000 + [5000 * number, 0, 0]).astype(int).tolist()
        objects = {f"b{number}": city()["CityObjects"]["b1"]}
        lines.append(
            {
                "type": "CityJSONFeature",
                "id": f"b{number}",
                "CityObjects": objects,
                "vertices": vertices,
            }
        )
    path = tmp_path / "a.city.jsonl"
    path.write_text("\n".join(json.dumps(line) for line in lines))
    mesh = read(path).mesh
    assert len(mesh.faces) == 36
    assert np.allclose(np.ptp(mesh.vertices, axis=0), [12, 3, 4])


@pytest.mark.thorough
def test_the_reference_of_delft(shared_data):
    path = shared_data / "airborne" / "delft-ahn3" / "reference" / "testarea.json"
    model = read(path)
    document = json.loads(path.read_text())
    vertices = np.array(document["vertices"], float)
    rings = []
    for one in document["CityObjects"].values():
        for geometry in one["geometry"]:
            solid = geometry["type"] == "Solid"
            rings += geometry["boundaries"][0] if solid else geometry["boundaries"]
    three = np.array([p[0] for p in rings if len(p) == 1 and len(p[0]) == 3])
    a, b, c = np.moveaxis(vertices[three], 1, 0)
    expected = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    for polygon in (p for p in rings if len(p) > 1 or len(p[0]) > 3):
        for sign, ring in zip([1] + [-1] * 99, polygon, strict=False):
            p = vertices[ring]
            turned = np.cross(p - p[0], np.roll(p, -1, axis=0) - p[0]).sum(axis=0)
            expected += sign * np.linalg.norm(turned) / 2
    assert model.crs.to_epsg() == 7415
    assert area(model.mesh) == pytest.approx(expected, rel=1e-6)
    assert not model.problems


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"type": "FeatureCollection"}, "JSON of another kind"),
        ({"CityObjects": {}}, "no surface"),
        ({"vertices": [[0, 0]]}, "triples"),
        ({"vertices": [[0, 0, float("nan")]] * 8}, "NaN, which is not"),
        ({"transform": {"scale": [1]}}, "transform"),
        ({"metadata": {"referenceSystem": "urn:ogc:def:crs:EPSG::999999"}}, "referenceSystem"),
    ],
)
def test_what_is_wrong_is_told_in_a_line(tmp_path, change, said):
    with pytest.raises(InputError) as caught:
        read(written(tmp_path / "a.json", city(**change)))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_one_wrong_object_is_told_and_the_rest_is_read(tmp_path):
    document = city()
    document["CityObjects"]["bad"] = {
        "type": "Building",
        "geometry": [{"type": "MultiSurface", "lod": "2", "boundaries": [[[0, 1, 99]]]}],
    }
    model = read(written(tmp_path / "a.json", document))
    assert volume(model.mesh) == pytest.approx(24.0)
    assert model.problems[0].startswith("bad:")
