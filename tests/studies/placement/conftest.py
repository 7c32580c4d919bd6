"""A motion of a few actors on the example, and a question that is answered in a second."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from urbantwin.studies.placement.place import Question, ask
from urbantwin.studies.placement.place_file import PlaceSpec
from urbantwin.traffic import Motion
from urbantwin.traffic.assets import asset_mesh
from urbantwin.traffic.motion import ACTOR_SCHEMA
from urbantwin.traffic.signals import SIGNAL_SCHEMA

STEP_S = 0.2

#: Two corners of the junction and a place far out, one cheap sensor: few views.
SPEC = {
    "candidates": {
        "kinds": [],
        "places": [
            {"name": "corner", "east_m": 14.0, "north_m": -14.0},
            {"name": "opposite", "east_m": -14.0, "north_m": 14.0, "kind": "pole"},
            {"name": "far out", "east_m": -30.0, "north_m": -14.0, "heights_m": [4.0]},
        ],
    },
    "heights_m": [4.0, 6.0],
    "tilt_deg": [0.0, 10.0],
    "models": [{"model": "VLP-16", "price": 4000.0}],
    "sensors": {"least": 1, "most": 2},
    "step_s": 0.4,
}


def motion_of(twin, rows, steps):
    """Return a motion of rows given as mappings; what a row does not say is 0."""
    filled = [
        {
            field.name: row.get(field.name, "" if pa.types.is_string(field.type) else 0)
            for field in ACTOR_SCHEMA
        }
        for row in rows
    ]
    manifest = {
        "kind": "motion", "version": 1, "seed": 7, "steps": steps, "step_s": STEP_S,
        "duration_s": steps * STEP_S, "twin_sha256": twin.sha256,
    }  # fmt: skip
    actors = pa.Table.from_pylist(filled, schema=ACTOR_SCHEMA)
    return Motion(manifest, actors, SIGNAL_SCHEMA.empty_table())


def actor(track, kind, name, x, y, yaw=0.0):
    """Return a row of an actor, which stands on the road that is about level there."""
    size = np.ptp(asset_mesh(name, 0).vertices, axis=0)
    return {
        "track": track, "class": kind, "asset": name, "x": x, "y": y, "z": 0.03 * x, "yaw": yaw,
        "length": size[0], "width": size[1], "height": size[2],
    }  # fmt: skip


@pytest.fixture(scope="session")
def motion(two_avenues_twin):
    """A car drives east, another stands beside a truck, a pedestrian crosses."""
    rows = []
    for step in range(11):
        time_s = round(step * STEP_S, 9)
        rows += [
            {"time_s": time_s, **one}
            for one in (
                actor(1, "car", "car-sedan", -20 + 8 * time_s, -6.0) | {"speed": 8.0},
                actor(2, "truck", "truck-box-7t5", 6.0, 6.0),
                actor(3, "car", "car-hatchback", 6.0, 9.4),
                actor(4, "pedestrian", "pedestrian-man", -12.0, -9 + time_s, 1.57) | {"speed": 1.0},
            )
        ]
    return motion_of(two_avenues_twin, rows, 11)


@pytest.fixture(scope="session")
def question(two_avenues_twin, motion) -> Question:
    """Return the question of `SPEC`."""
    spec = PlaceSpec.model_validate(SPEC)
    return ask(two_avenues_twin, motion, spec, layouts=20, seed=3)


@pytest.fixture(scope="session")
def casts(question, tmp_path_factory):
    """Return what views see, cast when it is asked for."""
    from urbantwin.studies.placement.sighting import casts_in

    folder: Path = tmp_path_factory.mktemp("casts")
    with casts_in(folder, question.views, question.recipe, 1) as found:
        yield found
