"""Simple worlds that LiDAR tests share."""

from collections.abc import Callable

import numpy as np
import pytest

from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.lidar.actor_path import PosedActor
from urbantwin.lidar.placement import place_rig
from urbantwin.lidar.rig import Rig
from urbantwin.site.rig import RigSpec
from urbantwin.taxonomy import ACTOR_CLASSES, material_id, semantic_id
from urbantwin.traffic.assets import asset, asset_names

_QUADS = np.array(
    [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
)


def _box(low, high, semantic="building", material="plaster", part=1, *, floor=True):
    x0, y0, z0 = low
    x1, y1, z1 = high
    flat = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    vertices = [(*xy, z0) for xy in flat] + [(*xy, z1) for xy in flat]
    quads = _QUADS if floor else _QUADS[1:]
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return LabelledMesh.build(vertices, faces, semantic_id(semantic), material_id(material), part)


def _ground(half=100.0, z=0.0, semantic="road", material="asphalt"):
    vertices = [(-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z)]
    return LabelledMesh.build(
        vertices, [[0, 1, 2], [0, 2, 3]], semantic_id(semantic), material_id(material)
    )


@pytest.fixture(scope="session")
def box_mesh() -> Callable[..., LabelledMesh]:
    """Return a maker of closed boxes (``floor=False``: open below)."""
    return _box


@pytest.fixture(scope="session")
def ground_mesh() -> Callable[..., LabelledMesh]:
    """Return a maker of flat square grounds."""
    return _ground


@pytest.fixture(scope="session")
def street() -> LabelledMesh:
    """Return a crossing: ground, four blocks of buildings, and a pole."""
    blocks = [
        _box((x, y, 0), (x + 30, y + 30, 12), part=k + 1)
        for k, (x, y) in enumerate([(12, 12), (-42, 12), (-42, -42), (12, -42)])
    ]
    pole = _box((9.9, 9.9, 0), (10.1, 10.1, 6), "pole", "metal-painted", 9)
    return LabelledMesh.concatenate([_ground(), *blocks, pole])


@pytest.fixture(scope="session")
def rig_of() -> Callable[..., Rig]:
    """Return a maker of rigs: ``rig_of(mesh, {sensor}, {sensor}, frame=...)``."""

    def make(mesh, *sensors, frame="level", **rig):
        standard = {"model": "OS1-128", "east_m": 0.0, "north_m": 0.0, "height_m": 5.0}
        named = [{"name": f"s{k}", **standard, **one} for k, one in enumerate(sensors)]
        spec = RigSpec.model_validate({"frame": frame, "sensors": named, **rig})
        return place_rig(spec, mesh, file="rig.yaml")

    return make


@pytest.fixture(scope="session")
def crowd() -> Callable[..., list[PosedActor]]:
    """Return a maker of actors of every class scattered over the two streets."""

    def make(count, seed, spread=60.0):
        rng = np.random.default_rng(seed)
        classes = [name for name in ACTOR_CLASSES if asset_names(name)]
        actors = []
        for track in range(1, count + 1):
            actor_class = classes[track % len(classes)]
            names = asset_names(actor_class)
            along, across = rng.uniform(-spread, spread), rng.uniform(-8, 8)
            xy = (along, across) if track % 2 else (across, along)
            pose = Pose.from_ypr(
                (*xy, rng.uniform(0, 0.1)),
                rng.uniform(-np.pi, np.pi),
                *rng.uniform(-0.08, 0.08, 2),
            )
            phase = int(rng.integers(12)) if actor_class == "pedestrian" else 0
            name = names[track % len(names)]
            phase %= asset(name).phases
            actors.append(PosedActor(track, actor_class, name, phase, pose, np.zeros(3)))
        return actors

    return make
