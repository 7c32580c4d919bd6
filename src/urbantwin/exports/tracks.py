"""A motion's tracks for other programs: CSV, and ASAM OpenLABEL."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import csv

from urbantwin.artefact import replaced_file
from urbantwin.exports.openlabel_document import openlabel_document, write_openlabel_file
from urbantwin.traffic import Motion
from urbantwin.traffic.motion_rows import ACTOR_SCHEMA

__all__ = ["write_openlabel", "write_tracks"]

_COLUMNS = {
    "track": "track_id",
    "time_s": "time_s",
    "class": "class",
    "x": "x",
    "y": "y",
    "z": "z",
    "yaw": "yaw_rad",
    "speed": "speed_mps",
    "length": "length",
    "width": "width",
    "height": "height",
}
_PLACES = 6  # micrometres, microradians


def write_tracks(motion: Motion, path: Path) -> None:
    """Write a motion's actors as CSV, a row per actor and step; site frame, metres, rad, seconds.

    x and y are the centre of the bounds, z is the ground. ``urbantwin traffic replay`` reads it.
    """
    kinds = pa.schema([(to, ACTOR_SCHEMA.field(name).type) for name, to in _COLUMNS.items()])
    how = csv.WriteOptions(quoting_style="none")
    with (
        replaced_file(path, kind="tracks") as scratch,
        csv.CSVWriter(scratch, kinds, write_options=how) as file,
    ):
        for part in motion.rows.parts(list(_COLUMNS)):
            file.write_table(pa.table([_rounded(x) for x in part.columns], kinds))


def _rounded(column: pa.ChunkedArray) -> pa.ChunkedArray:
    """Return a column with numbers rounded for writing."""
    if not pa.types.is_floating(column.type):
        return column
    return pa.chunked_array([np.round(column.to_numpy(), _PLACES)])


def write_openlabel(motion: Motion, path: Path) -> None:
    """Write a motion's actors as ASAM OpenLABEL 1.0.0: a cuboid per actor and frame."""
    rows = {name: motion.actors[name].to_pylist() for name in motion.actors.column_names}
    frames: dict[str, Any] = {
        str(k): {"frame_properties": {"timestamp": float(time_s)}, "objects": {}}
        for k, time_s in enumerate(motion.times())
    }
    objects: dict[str, Any] = {}
    for k, time_s in enumerate(rows["time_s"]):
        name = str(rows["track"][k])
        objects.setdefault(name, {"name": f"actor {name}", "type": rows["class"][k]})
        up = rows["height"][k] / 2
        roll, pitch, yaw = (rows[one][k] for one in ("roll", "pitch", "yaw"))
        middle = (rows["x"][k], rows["y"][k], rows["z"][k] + up)
        sides = (rows["length"][k], rows["width"][k], rows["height"][k])
        values = [round(float(one), _PLACES) for one in (*middle, roll, pitch, yaw, *sides)]
        cuboid = {"name": "box", "coordinate_system": "site", "val": values}
        frame = frames[str(round(time_s / motion.step_s))]
        frame["objects"][name] = {"object_data": {"cuboid": [cuboid]}}
    whole = openlabel_document(
        "tracks",
        coordinate_systems={"site": {"type": "scene_cs", "parent": ""}},
        objects=objects,
        frames=frames,
    )
    with replaced_file(path, kind="openlabel") as scratch:
        write_openlabel_file(scratch, whole)
