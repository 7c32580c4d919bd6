"""Meshes of actors that people bring along: axes, units, materials, and what is refused."""

import base64
import json

import numpy as np
import pytest

from urbantwin.errors import InputError
from urbantwin.reconstruct.actor_mesh import read_actor_mesh
from urbantwin.taxonomy import material_id, semantic_id


def write_box(path, low, high, *, material="Paint_Red"):
    """Write a box as glTF (y up) and return the path."""
    corners = np.array(
        [[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    )
    faces = np.array(
        [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6],
         [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    )  # fmt: skip
    data = corners.astype("<f4").tobytes() + faces.astype("<u2").tobytes()
    view = [
        {"buffer": 0, "byteOffset": 0, "byteLength": 96},
        {"buffer": 0, "byteOffset": 96, "byteLength": 72},
    ]
    document = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "scene": 0,
        "nodes": [{"mesh": 0, "name": "Shell"}],
        "materials": [{"name": material}],
        "meshes": [
            {"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}
        ],
        "buffers": [
            {
                "byteLength": len(data),
                "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode(),
            }
        ],
        "bufferViews": view,
        "accessors": [
            {
                "bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3",
                "min": list(map(float, low)), "max": list(map(float, high)),
            },
            {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR"},
        ],
    }  # fmt: skip
    path.write_text(json.dumps(document))
    return path


def test_a_vehicle_faces_along_its_longer_side_and_stands_on_the_ground(tmp_path) -> None:
    for low, high in (((-2, 0.3, -1), (2.4, 1.8, 1)), ((-1, 0.3, -2), (1, 1.8, 2.4))):
        mesh = read_actor_mesh(write_box(tmp_path / "a.gltf", low, high), "car")
        np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), [4.4, 2.0, 1.5], atol=1e-6)
        np.testing.assert_allclose(mesh.vertices.min(axis=0), [-2.2, -1.0, 0.0], atol=1e-6)
        assert set(mesh.semantic) == {semantic_id("car")}
        assert set(mesh.material) == {material_id("metal-painted")}


@pytest.mark.parametrize("forward", ["x", "-x", "z", "-z"])
def test_axes_turn_without_a_mirror(tmp_path, forward) -> None:
    # What lies ahead in the file lies ahead; what is to its left, seen from above, to the left.
    ahead = {"x": [1, 0, 0], "-x": [-1, 0, 0], "z": [0, 0, 1], "-z": [0, 0, -1]}[forward]
    left = np.cross([0, 1, 0], ahead)
    low, high = np.array([-1.0, 0, -1.0]), np.array([1.0, 1.5, 1.0])
    high = high + np.abs(ahead) * 2.0  # longer along the way ahead
    path = write_box(tmp_path / "a.gltf", low, high)
    mesh = read_actor_mesh(path, "car", forward=forward)
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx([4.0, 2.0, 1.5])
    corners = np.array(
        [[x, y, z] for x in (low[0], high[0]) for y in (0, 1.5) for z in (low[2], high[2])]
    )
    along, across = corners @ ahead, corners @ left
    expected = np.column_stack(
        [along - (along.min() + along.max()) / 2, across - (across.min() + across.max()) / 2]
    )
    np.testing.assert_allclose(mesh.vertices[:, :2], expected, atol=1e-6)
    a, b, c = np.moveaxis(mesh.triangles(), 1, 0)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) > 0  # not inside out


def test_a_file_in_centimetres_is_refused_until_it_has_a_scale(tmp_path) -> None:
    path = write_box(tmp_path / "a.gltf", (-220, 0, -90), (220, 150, 90))
    with pytest.raises(InputError, match=r"440 m long.*car.*scale"):
        read_actor_mesh(path, "car")
    mesh = read_actor_mesh(path, "car", scale=0.01)
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx([4.4, 1.8, 1.5])
    with pytest.raises(InputError, match="not found"):
        read_actor_mesh(tmp_path / "none.gltf", "car")


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("Glass_Tinted", "glass"),
        ("Tyre", "rubber"),
        ("License_Plate", "retroreflector"),
        ("Chrome", "metal-bare"),
        ("Fabric", "cloth"),
        ("Material.001", "metal-painted"),
    ],
)
def test_materials_are_told_by_their_names(tmp_path, name, expected) -> None:
    path = write_box(tmp_path / "a.gltf", (-2, 0, -1), (2.4, 1.5, 1), material=name)
    assert set(read_actor_mesh(path, "car").material) == {material_id(expected)}


def test_the_car_and_the_human_of_openmaterial_join_unedited(shared_data) -> None:
    folder = shared_data / "meshes" / "openmaterial" / "examples"
    car = read_actor_mesh(folder / "vehicle_example" / "vehicle_example.gltf", "car")
    assert np.ptp(car.vertices, axis=0) == pytest.approx([3.855, 1.618, 1.296], abs=1e-3)
    found = {
        key: car.select(car.material == material_id(key)).vertices
        for key in ("rubber", "glass", "retroreflector", "cloth")
    }
    # Tyres stand on the ground; plates are at both ends; seats are inside.
    assert found["rubber"][:, 2].min() == pytest.approx(0.0, abs=1e-3)
    assert np.ptp(found["retroreflector"][:, 0]) > 3.6
    assert np.abs(found["cloth"]).max(axis=0)[0] < 1.6
    assert found["glass"][:, 2].max() > 1.0
    human = read_actor_mesh(folder / "human_example" / "human_example.gltf", "pedestrian")
    assert human.vertices[:, 2].max() == pytest.approx(1.78, abs=0.01)
    # The arms are stretched to the sides.
    assert np.ptp(human.vertices, axis=0)[1] > 1.0 > np.ptp(human.vertices, axis=0)[0]
    assert {material_id("skin"), material_id("cloth")} <= set(human.material.tolist())
