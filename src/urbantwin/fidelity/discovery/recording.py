"""Discovery in a recording on disk: reads frames, writes and draws the results."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from matplotlib import colormaps
from matplotlib.ticker import NullFormatter, StrMethodFormatter
from numpy.typing import NDArray

from urbantwin.artefact import replaced_file, replaced_folder, write_json
from urbantwin.errors import InputError
from urbantwin.fidelity.discovery.blind_sectors import Losses, losses_of
from urbantwin.fidelity.discovery.discover import discover
from urbantwin.fidelity.discovery.point_rays import columns_in
from urbantwin.fidelity.discovery.result import Discovery, FoundSensor
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers import open_recording
from urbantwin.fidelity.report_style import FAINT, INK, blank, from_above, save
from urbantwin.fidelity.sampling import evenly
from urbantwin.geometry import row_keys
from urbantwin.lidar import Sensor
from urbantwin.lidar.sensor_file import sensor_document
from urbantwin.progress import Progress, between, each
from urbantwin.reconstruct.recording import LEAST_FRAMES, Looks, RecordedFrames
from urbantwin.reconstruct.recording.beams import recorded_beams

__all__ = ["discover_recording", "draw_discovery", "write_frames", "write_rig"]

#: Difference of a unit's channels from its model, degrees, from which it gets its own sensor file.
_AS_MODEL_DEG = 0.02
#: Record of each point: -1 for a point that is on no ring.
RAYS = np.dtype([("sensor", "<i2"), ("ring", "<i2"), ("column", "<i4")])
_HEAD = """\
# Found by `urbantwin rig discover` in points of frames: x, y, z of their frame as east, north, up.
# Points do not show the yaw: it is 0 here, and columns count from there. The rate is assumed.
"""


def write_rig(
    found: Discovery, path: Path, rate_hz: float = 10.0, losses: Sequence[Losses] = ()
) -> list[Path]:
    """Write the sensors as a rig, with a sensor file for each unit that differs from its model.

    Args:
        found: the sensors.
        path: the ``rig.yaml`` to write; sensor files are named after it.
        rate_hz: frames per second, which points do not show.
        losses: blind sectors and dropout rate of each sensor, if known.

    Returns:
        The sensor files.
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
    """Return the sensor file of one unit: its own elevations, all else from its model."""
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
    """Write frames as points and rays, in the layout of our datasets.

    ``points/NAME.npy`` (N, 3 or 4) float32, ``rays/NAME.npy`` (N,) of `RAYS`. Our readers open the
    folder with rings and columns.

    Args:
        found: the sensors.
        frames: frames of the recording in which they were found.
        folder: existing folder, in which ``points`` and ``rays`` are created.

    Returns:
        Numbers of frames and points written, and the share of the points on rings.
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


_BINS, _MARGIN_DEG = 640, 1.0


def draw_discovery(found: Discovery, points: NDArray[np.float64], path: Path) -> None:
    """Draw one frame with the sensors found.

    Left, the points from above in the colours of their sensors, grey for points on no ring; right,
    a histogram of the elevations of each sensor's points, with the channels of its unit.

    Args:
        found: the sensors.
        points: (N, 3) points of a frame.
        path: the PNG to write.
    """
    rays = found.rays(points)
    count = len(found.sensors)
    shades = np.array([colormaps["tab10"](number % 10)[:3] for number in range(count)])
    middle = np.median(points, axis=0)
    reach = float(np.percentile(np.abs(points[:, :2] - middle[:2]).max(axis=1), 97))
    figure = blank(16.0, 8.4)
    grid = figure.add_gridspec(
        count, 2, left=0.04, right=0.98, top=0.95, bottom=0.07, width_ratios=[1, 1.05], hspace=0.6
    )
    plan = figure.add_subplot(grid[:, 0])
    on = rays.sensor >= 0
    layers = [(points[~on], np.array([0.8, 0.8, 0.8])), (points[on], shades[rays.sensor[on]])]
    share = f"{on.mean():.0%} of {len(points):,} points on rings of {count}"
    from_above(plan, f"From above: {share}", middle, reach, layers)
    for number, one in enumerate(found.sensors):
        plan.plot(*one.place[:2], "o", markersize=9, color=shades[number], markeredgecolor=INK)
        plan.annotate(
            one.name,
            (float(one.place[0]), float(one.place[1])),
            xytext=(7, 7),
            textcoords="offset points",
            fontsize=9,
            color=INK,
            weight="bold",
            bbox={"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1.5},
        )
        axes = figure.add_subplot(grid[number, 1])
        mine = rays.sensor == number
        seen = one.fit.seen_from.elevation_deg(points[mine])
        table = one.fit.unit.elevation_deg
        low, high = table.min() - _MARGIN_DEG, table.max() + _MARGIN_DEG
        axes.hist(seen, _BINS, range=(low, high), color=shades[number], log=True)
        for up in table:
            axes.axvline(up, color=INK, linewidth=0.4, alpha=0.35)
        which = " or ".join(one.models) or "no model of the catalogue"
        axes.set_title(
            f"{one.name}: {which}, {one.rings} rings, off its model by "
            f"{one.off_model_deg:.2f} degrees",
            loc="left",
            fontsize=9,
            color=INK,
        )
        axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.set_xlim(low, high)
        axes.tick_params(labelsize=7)
        for spine in axes.spines.values():
            spine.set_color(FAINT)
        if number == count - 1:
            axes.set_xlabel("elevation of points, degrees (lines: channels)", fontsize=8)
    with replaced_file(path, kind="discover picture") as scratch:
        save(figure, scratch)


#: Maximum number of frames used; longer recordings are sampled evenly.
_MOST_FRAMES = 12


def discover_recording(
    real: Path,
    rig: Path,
    picture: Path,
    frames_out: Path | None,
    tell: Progress,
) -> tuple[Discovery, dict[str, Any]]:
    """Find the sensors of a recording, and write the rig, a picture and optionally frames.

    Args:
        real: any recording that `readers.open_recording` opens; only its points are used.
        rig: the ``rig.yaml`` to write.
        picture: the PNG to write.
        frames_out: optional folder for all frames with sensor, ring and column of each point.
        tell: called with the fraction done and the current step.

    Returns:
        The sensors, and a summary of the written files.

    Raises:
        InputError: the recording cannot be read, or its sensors cannot be found.
    """
    recording = open_recording(real)
    used = evenly(len(recording), _MOST_FRAMES)
    if not used:
        raise InputError("holds no frames", file=real, expected="at least one")
    reading = between(tell, 0.0, 0.05)
    frames = [recording.read(number).points for number in each(used, reading, "reading")]
    names = [recording.names[number] for number in used]
    most = 0.9 if frames_out is None else 0.6
    try:
        found = discover(frames, names, tell=between(tell, 0.05, most))
    except InputError as error:
        raise InputError(
            error.problem, file=real, place=error.place, expected=error.expected
        ) from None
    written: dict[str, Any] = {}
    losses: list[Losses] = []
    if frames_out is not None:
        writing = between(tell, most, 0.95)
        every = (recording.read(n) for n in each(range(len(recording)), writing, "rings"))
        with replaced_folder(frames_out, kind="discovery", inputs=[real]) as folder:
            written["rays"] = write_frames(found, every, folder)
            write_json(folder / "discovery.json", {"kind": "discovery", **found.report()})
            if len(recording) >= LEAST_FRAMES:
                looks = Looks(RecordedFrames(folder))
                written["moving"] = _write_moving(looks, folder)
                losses = _losses(looks, found)
    draw_discovery(found, frames[0], picture)
    written["units"] = [str(one) for one in write_rig(found, rig, losses=losses)]
    return found, written


def _write_moving(looks: Looks, folder: Path) -> float:
    """Write the masks of moving points, ``moving/NAME.npy``; return the share of moving points."""
    (folder / "moving").mkdir()
    points, moving = 0, 0
    for number, name in enumerate(looks.frames.names):
        moves = looks.moving(looks.frames.read(number))
        np.save(folder / "moving" / f"{name}.npy", moves)
        points, moving = points + len(moves), moving + int(moves.sum())
    return round(moving / max(points, 1), 4)


def _losses(looks: Looks, found: Discovery) -> list[Losses]:
    """Return the blind sectors and the dropout rate of each sensor."""
    counted = [np.zeros(one.channels) for one in looks.frames.sensors]
    for number in range(len(looks.frames)):
        frame = looks.frames.read(number)
        for k, sensor in enumerate(looks.frames.sensors):
            mine = frame.sensor == k
            rings = frame.ring[mine]
            if found.sensors[k].dual:  # a firing with two returns counts once
                looks_of = np.column_stack([rings, frame.column[mine]])
                rings = rings[np.unique(row_keys(looks_of), axis=0, return_index=True)[1]]
            counted[k] += np.bincount(rings, minlength=sensor.channels) / len(looks.frames)
    lost = []
    for beams, points, one in zip(recorded_beams(looks), counted, found.sensors, strict=True):
        model = one.fit.unit.model
        lost.append(losses_of(beams, points, one.columns if model is None else model.columns))
    return lost
