"""The files of a discovery: a rig, sensors' files of units, frames with rings and columns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from urbantwin.artefact import replaced_file
from urbantwin.fidelity.discovery.blind_sectors import Losses
from urbantwin.fidelity.discovery.point_rays import columns_in
from urbantwin.fidelity.discovery.result import Discovery, FoundSensor
from urbantwin.fidelity.frame import Frame
from urbantwin.lidar import Sensor
from urbantwin.lidar.sensor_file import sensor_document

__all__ = ["RAYS", "write_frames", "write_rig"]

#: A unit whose channels differ from its model's by more, degrees, gets a sensor's file of its own.
_AS_MODEL_DEG = 0.02
#: What is written of each point: -1 for a point that is on no sensor's ring.
RAYS = np.dtype([("sensor", "<i2"), ("ring", "<i2"), ("column", "<i4")])
_HEAD = """\
# Found by `urbantwin rig discover` in points of frames: x, y, z of their frame as east, north, up.
# Points do not show the yaw: it is 0 here, and columns count from there. The rate is assumed.
"""


def write_rig(
    found: Discovery, path: Path, rate_hz: float = 10.0, losses: Sequence[Losses] = ()
) -> list[Path]:
    """Write the sensors as a rig, and a sensor's file beside it for each unit unlike its model.

    Args:
        found: the sensors.
        path: the ``rig.yaml`` to write; others are named after it.
        rate_hz: frames per second, which points do not show.
        losses: of each sensor where it is blind and what it loses, if that is known.

    Returns:
        The sensors' files.
    """
    rows: list[dict[str, Any]] = []
    units, notes = {}, []
    for number, one in enumerate(found.sensors):
        model = one.fit.unit.model
        name = one.models[0] if one.models else ""
        if model is None or one.off_model_deg > _AS_MODEL_DEG:
            name = f"{path.stem}-{one.name}.yaml"
            units[name] = _yaml(_unit(one, model))
        stated = one.report()
        pose = {key: stated[key] for key in ("east_m", "north_m", "up_m", "pitch_deg", "roll_deg")}
        lost = losses[number].written() if losses else {}
        both = {"returns": "dual"} if one.dual else {}
        rows.append({"name": one.name, "model": name, **pose, "yaw_deg": 0.0, **both, **lost})
        which = " or ".join(one.models) or "no model of the catalogue"
        notes.append(
            f"# {one.name}: {which}; place +-{stated['sigma_plan_m']} m in plan and "
            f"+-{stated['sigma_up_m']} m up, tilt +-{stated['sigma_tilt_deg']} degrees\n"
        )
    document = {"rate_hz": rate_hz, "frame": "site", "sensors": rows}
    with replaced_file(path, kind="discover") as scratch:
        for name, text in units.items():
            scratch.with_name(name).write_text(text, encoding="utf-8")
        scratch.write_text(_HEAD + "".join(notes) + _yaml(document), encoding="utf-8")
    return [path.with_name(name) for name in units]


def _yaml(document: dict[str, Any]) -> str:
    return yaml.safe_dump(document, sort_keys=False, allow_unicode=True)


def _unit(one: FoundSensor, model: Sensor | None) -> dict[str, Any]:
    """Return the sensor's file of one unit: its own elevations, and all else of its model."""
    elevation = np.round(one.fit.unit.elevation_deg, 4)
    sources = {"elevation_deg": "urbantwin rig discover: rings in points"}
    if model is None:
        unit = Sensor.of_beams("unknown", elevation, np.zeros(len(elevation)), one.columns, 10.0)
        unit = replace(unit, name="unknown")
    else:
        unit = replace(model, name=one.models[0], aliases=(), elevation_deg=elevation)
    name = f"{unit.name} as {one.name}"
    return sensor_document(replace(unit, name=name, sources={**unit.sources, **sources}))


def write_frames(found: Discovery, frames: Iterable[Frame], folder: Path) -> dict[str, Any]:
    """Write frames as points and rays, as our datasets have them.

    ``points/NAME.npy`` (N, 3 or 4) float32, ``rays/NAME.npy`` (N,) of `RAYS`. Every reader of
    this project takes the folder, with rings and columns.

    Args:
        found: the sensors.
        frames: of the recording they were found in.
        folder: that is there, and gets ``points`` and ``rays``.

    Returns:
        How many frames and points were written, and which share of them lies on rings.
    """
    (folder / "points").mkdir()
    (folder / "rays").mkdir()
    frames_done, points, on = 0, 0, 0
    for frame in frames:
        rays = found.rays(frame.points)
        table = np.full(len(frame.points), -1, [(name, "<i8") for name in RAYS.names or ()])
        table["sensor"], table["ring"] = rays.sensor, rays.ring
        for number, one in enumerate(found.sensors):
            mine = rays.sensor == number
            table["column"][mine] = columns_in(rays, number, one.fit.unit.model, one.columns)
        columns = [frame.points]
        if frame.intensity is not None:
            columns.append(frame.intensity[:, None])
        name = f"{Path(frame.name).stem}.npy"
        np.save(folder / "points" / name, np.hstack(columns).astype("<f4"))
        np.save(folder / "rays" / name, table.astype(RAYS))
        frames_done, points = frames_done + 1, points + len(rays.sensor)
        on += int((rays.sensor >= 0).sum())
    return {"frames": frames_done, "points": points, "on_rings": round(on / max(points, 1), 4)}
