"""Boxes mended by rays, where it is known what the rays met."""

import importlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import open3d
import pytest

from urbantwin.geometry import Pose
from urbantwin.taxonomy import material_id

pytestmark = pytest.mark.thorough

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
EYE = np.array([1.0, 8.0, 1.0])


@pytest.fixture(scope="module")
def modules():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(BENCHMARKS))
        names = ("argoverse_log", "argoverse_world", "pittsburgh_actors")
        return [importlib.import_module(name) for name in names]


def box_of(log, size):
    pose = Pose(np.eye(3), np.array([0.0, 0.0, size[2] / 2 - 1.0]))
    return log.ActorBox("REGULAR_VEHICLE", "track", size, pose, np.zeros(3), 0.0, 50.0)


def rays_at(actors, mesh):
    """Rays over a wide view; they end at the mesh, as Open3D finds it, or on a wall behind it."""
    turn, rise = np.meshgrid(
        np.radians(np.arange(-130, -65, 0.4)), np.radians(np.arange(-15, 2, 1))
    )
    way = np.stack([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)], -1)
    way = way.reshape(-1, 3)
    wall = (-20.0 - EYE[1]) / way[:, 1]
    reach = wall
    if mesh is not None:
        scene = open3d.t.geometry.RaycastingScene()
        faces = mesh.faces[mesh.material != material_id("glass")]
        scene.add_triangles(mesh.vertices.astype(np.float32), faces.astype(np.uint32))
        rays = np.hstack([np.broadcast_to(EYE, way.shape), way]).astype(np.float32)
        hit = scene.cast_rays(open3d.core.Tensor(rays))["t_hit"].numpy()
        reach = np.minimum(hit, wall)
    return actors.SweepRays(np.broadcast_to(EYE, way.shape), EYE + reach[:, None] * way)


@pytest.mark.parametrize("name", ["car-sedan", "car-minibus"])
def test_a_car_beside_its_box_is_found(modules, name):
    log, world, actors = modules
    size, shift = np.array([4.5, 1.8, 1.6]), np.array([0.15, -0.35, 0.0])
    box = box_of(log, size)
    mesh = world.mesh_in_box("REGULAR_VEHICLE", size, name=name)
    mesh = replace(mesh, vertices=mesh.vertices + box.pose.translation + shift)
    found = actors.mended(box, [box], rays_at(actors, mesh))
    assert found.mesh == name
    assert found.panes
    # The sides that are seen: the far one may be anywhere.
    near = found.pose.translation[1] + found.size[1] / 2
    assert near == pytest.approx(shift[1] + size[1] / 2, abs=0.05)
    assert found.pose.translation[0] == pytest.approx(shift[0], abs=0.1)
    assert found.size[2] == pytest.approx(size[2], abs=0.08)


def test_a_box_that_rays_pass_holds_no_car(modules):
    log, _, actors = modules
    box = box_of(log, np.array([4.5, 1.8, 1.6]))
    assert actors.mended(box, [box], rays_at(actors, None)) is None


def test_a_box_of_no_other_sweep_stays(modules):
    log, _, actors = modules
    box = box_of(log, np.array([4.5, 1.8, 1.6]))
    assert actors.mended(box, [], rays_at(actors, None)) is box
