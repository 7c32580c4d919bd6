"""What beams find behind glass."""

import numpy as np
import pytest

from urbantwin.geometry import LabelledMesh
from urbantwin.lidar import Scanner
from urbantwin.taxonomy import material_id, semantic_id

EXACT = {"noise": False, "dropout": False, "quantisation": False, "footprint": False, "sun": False}


def sheet(x, semantic, material):
    """A wall across the x axis."""
    vertices = [(x, -10, -10), (x, 10, -10), (x, 10, 10), (x, -10, 10)]
    return LabelledMesh.build(
        vertices, [[0, 1, 2], [0, 2, 3]], semantic_id(semantic), material_id(material)
    )


def ranges(rig_of, ground_mesh, pane_class, **place):
    far = ground_mesh(half=200.0, z=-60.0)
    world = LabelledMesh.concatenate(
        [sheet(8.0, pane_class, "glass"), sheet(12.0, "pole", "plaster")]
    )
    rig = rig_of(far, {"height_m": 60.0, "effects": EXACT, **place}, frame="sensor")
    frame = Scanner(world, rig, 0).scan(0, [])
    ahead = np.abs(frame.points[:, 1:3]).max(axis=1) < 0.15 * frame.points[:, 0]
    return frame.points[ahead, 0], frame.points[ahead, 3], frame.echo[ahead]


def test_the_wall_behind_a_pane_is_the_stronger_echo(rig_of, ground_mesh):
    x, bright, _ = ranges(rig_of, ground_mesh, "other-structure")
    np.testing.assert_allclose(x, 12.0, atol=1e-3)
    clear, _, _ = ranges(rig_of, ground_mesh, "other-structure", effects={**EXACT, "glass": False})
    np.testing.assert_allclose(clear, 8.0, atol=1e-3)
    # Twice through a pane that passes 85 %: the wall is 0.72 as bright as without it.
    plain = Scanner(
        sheet(12.0, "pole", "plaster"),
        rig_of(ground_mesh(half=200.0, z=-60.0), {"height_m": 60.0, "effects": EXACT},
               frame="sensor"), 0,
    ).scan(0, [])  # fmt: skip
    own = plain.points[np.abs(plain.points[:, 1:3]).max(axis=1) < 1.8, 3]
    assert bright.mean() / own.mean() == pytest.approx(0.72, abs=0.06)


def test_both_are_reported_as_dual_returns(rig_of, ground_mesh):
    x, _, echo = ranges(rig_of, ground_mesh, "other-structure", model="VLS-128", returns="dual")
    np.testing.assert_allclose(x[echo == 0], 12.0, atol=1e-3)
    np.testing.assert_allclose(x[echo == 1], 8.0, atol=1e-3)
    assert (echo == 1).sum() == (echo == 0).sum() > 100


def test_nothing_comes_back_from_inside_a_building(rig_of, ground_mesh):
    x, _, _ = ranges(rig_of, ground_mesh, "building")
    np.testing.assert_allclose(x, 8.0, atol=1e-3)
