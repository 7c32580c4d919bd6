"""A small twin, a small motion on it, and a small rig."""

import hashlib
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from urbantwin.artefact import sha256_of, write_json
from urbantwin.geometry import LabelledMesh
from urbantwin.lidar import place_rig
from urbantwin.site.rig import RigSpec
from urbantwin.taxonomy import material_id, semantic_id
from urbantwin.traffic import Motion
from urbantwin.traffic.assets import asset
from urbantwin.traffic.motion import ACTOR_SCHEMA
from urbantwin.traffic.signals import SIGNAL_SCHEMA
from urbantwin.twin import load_twin

STEPS = 12
STEP_S = 0.1
#: Step at which the first actor comes: the frames before it have no objects.
FIRST_STEP = 2


@pytest.fixture(scope="session")
def twin(tmp_path_factory):
    """A level street of 120 x 120 m with a wall on it."""
    folder = tmp_path_factory.mktemp("twin") / "twin"
    folder.mkdir()
    corners = np.array([[-60, -60, 0], [60, -60, 0], [60, 60, 0], [-60, 60, 0]], float)
    road = LabelledMesh.build(
        corners, [[0, 1, 2], [0, 2, 3]], semantic_id("road"), material_id("asphalt")
    )
    wall = LabelledMesh.build(
        [[5, 20, 0], [25, 20, 0], [25, 20, 6], [5, 20, 6]],
        [[0, 1, 2], [0, 2, 3]],
        semantic_id("other-structure"),
        material_id("concrete"),
    )
    LabelledMesh.concatenate([road, wall]).save(folder / "scene.npz")
    manifest = {
        "kind": "twin",
        "version": "test",
        "name": "test",
        "driving_side": "right",
        "notes": {},
        "anchor": {"latitude": 60.17, "longitude": 24.94},
        "region_m": corners[:, :2].tolist(),
        "inputs": [
            {"name": "map.osm", "sha256": "ab" * 32, "licence": "ODbL-1.0", "attribution": ""}
        ],
        "files": {"scene.npz": sha256_of(folder / "scene.npz")},
    }
    write_json(folder / "twin.json", manifest)
    (folder / "site.yaml").write_text("traffic:\n  seed: 0\n")
    return load_twin(folder)


def _motion_of(twin, rows, steps=STEPS, step_s=STEP_S):
    """A motion of rows given as mappings; what a row does not say is 0."""
    filled = [
        {
            field.name: row.get(field.name, "" if pa.types.is_string(field.type) else 0)
            for field in ACTOR_SCHEMA
        }
        for row in rows
    ]
    manifest = {"seed": 7, "steps": steps, "step_s": step_s, "twin_sha256": twin.sha256}
    actors = pa.Table.from_pylist(filled, schema=ACTOR_SCHEMA)
    return Motion(manifest, actors, SIGNAL_SCHEMA.empty_table())


@pytest.fixture(scope="session")
def motion(twin):
    """A car passes, a second one is hidden behind the wall, a pedestrian turns about."""
    rows = []
    for step in range(FIRST_STEP, STEPS):
        time_s = round(step * STEP_S, 9)
        rows += [
            {
                "time_s": time_s,
                "track": 4,
                "class": "car",
                "asset": "car-sedan",
                "x": -8 + 10 * time_s,
                "y": 8.0,
                "speed": 10.0,
            },
            {
                "time_s": time_s,
                "track": 9,
                "class": "car",
                "asset": "car-minibus",
                "x": 15.0,
                "y": 24.0,
                "yaw": np.pi / 4,
            },
            {
                "time_s": time_s,
                "track": 12,
                "class": "pedestrian",
                "asset": "pedestrian-man",
                "phase": step % asset("pedestrian-man").phases,
                "x": 6.0,
                "y": -3.0,
                "yaw": 3.0 + 0.1 * step,
                "pitch": 0.01,
                "speed": 1.0,
            },
        ]
    return _motion_of(twin, rows)


def _rig_spec(**changed) -> RigSpec:
    """One small sensor on a pole."""
    sensor = {
        "name": "pole",
        "model": "VLP-16",
        "columns": 900,
        "east_m": 0.0,
        "north_m": 0.0,
        "height_m": 3.0,
        "pitch_deg": 5.0,
        "yaw_deg": 30.0,
    }
    return RigSpec.model_validate({"sensors": [sensor], **changed})


@pytest.fixture(scope="session")
def rig(twin):
    """The small rig, placed."""
    return place_rig(_rig_spec(), twin.mesh)


def _digests(folder: Path) -> dict[str, str]:
    """SHA-256 of every file in a folder."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture(scope="session")
def dataset(twin, motion, rig, tmp_path_factory):
    """The small dataset, recorded in one process."""
    from urbantwin.dataset import record

    out = tmp_path_factory.mktemp("recorded") / "dataset"
    record(twin, motion, rig, out, workers=1, seed=5)
    return out


@pytest.fixture(scope="session")
def digests():
    """What gives the SHA-256 of every file in a folder."""
    return _digests


@pytest.fixture(scope="session")
def motion_of():
    """What makes a motion of rows."""
    return _motion_of


@pytest.fixture(scope="session")
def rig_spec():
    """What makes the small rig's spec, with changes."""
    return _rig_spec
