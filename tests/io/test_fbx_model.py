"""FBX as text that the test writes itself, and as Assimp writes it."""

import numpy as np
import pytest
import trimesh

from urbantwin.errors import InputError
from urbantwin.exports.mesh import fbx as fbx_of_assimp

from ..reconstruct.model_files import BOX, BOX_QUADS, area, read, volume

TEXT = """; FBX 7.4.0 project file
FBXHeaderExtension:  {{
    FBXHeaderVersion: 1003
    FBXVersion: 7400
}}
GlobalSettings:  {{
    Version: 1000
    Properties70:  {{
        P: "UpAxis", "int", "Integer", "",{up}
        P: "UpAxisSign", "int", "Integer", "",1
        P: "FrontAxis", "int", "Integer", "",{front}
        P: "FrontAxisSign", "int", "Integer", "",{sign}
        P: "CoordAxis", "int", "Integer", "",0
        P: "CoordAxisSign", "int", "Integer", "",1
        P: "UnitScaleFactor", "double", "Number", "",{unit_cm}
    }}
}}
Objects:  {{
    Geometry: 1, "Geometry::box", "Mesh" {{
        Vertices: *24 {{
            a: {vertices}
        }}
        PolygonVertexIndex: *24 {{
            a: {corners}
        }}
        LayerElementMaterial: 0 {{
            Version: 101
            MappingInformationType: "ByPolygon"
            ReferenceInformationType: "IndexToDirect"
            Materials: *6 {{
                a: 0,0,0,0,0,1
            }}
        }}
        Layer: 0 {{
            LayerElement:  {{
                Type: "LayerElementMaterial"
                TypedIndex: 0
            }}
        }}
    }}
    Model: 2, "Model::depot", "Mesh" {{
        Properties70:  {{
            P: "Lcl Translation", "Lcl Translation", "", "A",{move}
        }}
    }}
    Material: 3, "Material::brick", "" {{
        Properties70:  {{
            P: "DiffuseColor", "Color", "", "A",1,0,0.0
        }}
    }}
    Material: 4, "Material::slate", "" {{
        Properties70:  {{
            P: "DiffuseColor", "Color", "", "A",0,0,1
        }}
    }}
}}
Connections:  {{
    C: "OO",2,0
    C: "OO",1,2
    C: "OO",3,2
    C: "OO",4,2
}}
"""


def fbx(path, vertices, *, up, unit_cm, move):
    quads = [[*quad[:3], -quad[3] - 1] for quad in BOX_QUADS.tolist()]
    front, sign = (2, 1) if up == 1 else (1, -1)
    text = TEXT.format(
        up=up,
        front=front,
        sign=sign,
        unit_cm=unit_cm,
        vertices=",".join(str(v) for v in np.ravel(vertices)),
        corners=",".join(str(k) for quad in quads for k in quad),
        move=",".join(str(v) for v in move),
    )
    path.write_text(text)
    return path


@pytest.mark.parametrize(("unit_cm", "per_m"), [(1.0, 100.0), (100.0, 1.0), (2.54, 39.3700787)])
@pytest.mark.parametrize("up", [1, 2])
def test_units_axes_and_materials(tmp_path, up, unit_cm, per_m):
    place = np.array([10.0, 20.0, 5.0])
    model_axes = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]) if up == 1 else np.eye(3)
    path = fbx(
        tmp_path / "box.fbx",
        BOX @ model_axes.T * per_m,
        up=up,
        unit_cm=unit_cm,
        move=model_axes @ place * per_m,
    )
    model = read(path)
    mesh = model.mesh
    assert (model.up, model.unit_m) == ("z", 1.0)
    assert np.allclose(mesh.vertices.min(axis=0), place, atol=1e-6)
    assert np.allclose(mesh.vertices.max(axis=0), place + [2, 3, 4], atol=1e-6)
    assert volume(mesh) == pytest.approx(24.0, rel=1e-6)
    assert area(mesh) == pytest.approx(52.0, rel=1e-6)
    assert mesh.names == ("depot / brick", "depot / slate")
    assert mesh.colour[mesh.object == 0].tolist() == [[255, 0, 0]] * 10
    assert mesh.colour[mesh.object == 1].tolist() == [[0, 0, 255]] * 2
    assert np.allclose(mesh.triangles()[mesh.object == 1][:, :, 2], 9.0, atol=1e-6)


@pytest.mark.parametrize("keep", [0, 10, 60, 700, 1500])
def test_a_file_that_is_cut_short_is_told_in_a_line(tmp_path, keep):
    path = fbx(tmp_path / "box.fbx", BOX, up=2, unit_cm=100.0, move=(0, 0, 0))
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(InputError) as caught:
        read(path)
    assert "\n" not in str(caught.value)
    assert "box.fbx" in str(caught.value)


def test_a_hierarchy_that_assimp_writes(tmp_path):
    """A house that is placed, turned and stretched, and a chimney that goes with it."""
    turned = trimesh.transformations.rotation_matrix(0.5, [0, 1, 0], [0, 0, 0])
    placed = trimesh.transformations.translation_matrix([10, 3, -20]) @ turned  # glTF is y up
    placed = placed @ np.diag([1.0, 3.0, 2.0, 1.0])
    above = trimesh.transformations.translation_matrix([0, 2, 0])
    scene = trimesh.Scene()
    box = trimesh.creation.box((2, 2, 2))
    scene.add_geometry(box, node_name="house 1", geom_name="house", transform=placed)
    scene.add_geometry(
        trimesh.creation.box((1, 1, 1)), node_name="chimney", geom_name="chimney",
        parent_node_name="house 1", transform=above,
    )  # fmt: skip
    scene.add_geometry(box, node_name="far", geom_name="far", transform=above)
    scene.export(tmp_path / "house.glb")
    fbx_of_assimp._convert(tmp_path / "house.glb", tmp_path / "house.fbx")
    mesh = read(tmp_path / "house.fbx").mesh
    metres = mesh.triangles() * 100  # Assimp calls the metres of a glTF centimetres
    own = next(k for k, name in enumerate(mesh.names) if name.startswith("chimney"))
    chimney = metres[mesh.object == own].reshape(-1, 3)
    # Its middle is 2 above the house's, three times stretched; its sides are 1 x 2 x 3.
    assert np.allclose(chimney.mean(axis=0), [10, 20, 9], atol=0.01)
    assert np.allclose([chimney[:, 2].min(), chimney[:, 2].max()], [7.5, 10.5], atol=1e-4)
    assert volume(mesh) * 1e6 == pytest.approx(8 * 6 + 6 + 8, rel=1e-4)
