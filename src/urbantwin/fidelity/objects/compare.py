"""``compare --objects``: our bodies in the boxes of labelled real frames. It needs no twin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from urbantwin.artefact import replaced_folder, write_json
from urbantwin.errors import InputError
from urbantwin.fidelity.histograms import full_scale
from urbantwin.fidelity.objects.figures import FIGURES, figures_of
from urbantwin.fidelity.objects.measure import ObjectSeen, compare_objects
from urbantwin.fidelity.readers import Recording, open_recording
from urbantwin.lidar import sensor as model_of
from urbantwin.lidar.sensor import Sensor
from urbantwin.pages import write_page
from urbantwin.progress import Progress, untold

__all__ = ["ObjectsReport", "compare_in_boxes", "write_objects"]

#: What recorded data sets of a layout.
_SENSORS = {
    "kitti": "HDL-64E",
    "semantic-kitti": "HDL-64E",
    "argoverse2": "VLP-32C",
    "nuscenes": "HDL-32E",
    "tumtraf": "OS1-64",
}


@dataclass(frozen=True, eq=False)
class ObjectsReport:
    """What was found.

    Attributes:
        seen: the objects.
        figures: by class and distance, see `figures.figures_of`.
        problems: frames that were left out, and why.
        notes: what a reader of the figures must know.
    """

    seen: list[ObjectSeen]
    figures: list[dict[str, Any]]
    problems: list[str]
    notes: list[str]


def compare_in_boxes(
    recording: Recording,
    sensor: Sensor,
    *,
    numbers: Sequence[int] | None = None,
    progress: Progress | None = None,
) -> ObjectsReport:
    """Compare the labelled objects of a recording with our bodies in their boxes.

    Args:
        recording: real frames with labels.
        sensor: that recorded them.
        numbers: of the frames that are looked at; all if not given.
        progress: called with the fraction done and what is being done.

    Raises:
        InputError: no frame has an object that can be compared.
    """
    tell = progress or untold
    chosen = list(range(len(recording)) if numbers is None else numbers)
    seen: list[ObjectSeen] = []
    problems: list[str] = []
    notes = list(recording.notes)
    scale: float | None = None
    for done, number in enumerate(chosen):
        tell(0.95 * done / len(chosen), f"frame {done + 1} of {len(chosen)}")
        try:
            frame = recording.read(number)
            if frame.intensity is not None:
                scale = max(scale or 0.0, full_scale(float(frame.intensity.max())))
            seen += compare_objects(frame, sensor, scale=scale, seed=number)
            notes += [one for one in frame.notes if one not in notes]
        except InputError as error:
            problems.append(str(error))
    if not seen:
        raise InputError(
            "holds no labelled object with ten points that can be compared"
            + (f": {problems[0]}" if problems else ""),
            file=recording.path,
            expected="labelled frames of a spinning sensor, with rings or in their order",
        )
    return ObjectsReport(seen, figures_of(seen), problems, notes)


def write_objects(
    real: Path,
    out: Path,
    *,
    sensor: str | None = None,
    layout: str | None = None,
    columns: int | None = None,
    progress: Progress | None = None,
) -> ObjectsReport:
    """Compare and write ``objects.json``, ``objects.html`` and ``objects.png``.

    Args:
        real: labelled real frames in any layout that is known.
        out: the folder; an older report of objects there is replaced.
        sensor: name or file of the model that recorded them; what the layout tells if not given.
        layout: of the real frames; found if not given.
        columns: values per row of ``.bin`` files.
        progress: called with the fraction done and what is being done.

    Raises:
        InputError: it cannot be read, nobody says which sensor it is of, or there is no object.
    """
    tell = progress or untold
    recording = open_recording(real, layout, columns=columns)
    name = sensor or _SENSORS.get(recording.layout)
    if name is None:
        raise InputError(
            "does not say which sensor recorded it",
            file=real,
            expected="--sensor and a model (`urbantwin catalogue sensors` lists them)",
        )
    model = model_of(name)
    with replaced_folder(out, kind="objects", inputs=[real]) as folder:
        found = compare_in_boxes(recording, model, progress=tell)
        written = _as_json(found, real, model)
        write_json(folder / "objects.json", written)
        from urbantwin.fidelity.objects.picture import draw_objects_seen

        tell(0.96, "drawing the report")
        draw_objects_seen(found.seen, found.figures, folder / "objects.png")
        write_page(
            folder / "objects.html",
            "fidelity/objects/page.html.j2",
            report=written,
            drawn=folder / "objects.png",
        )
    tell(1.0, "compared")
    return found


def _as_json(found: ObjectsReport, real: Path, model: Sensor) -> dict[str, Any]:
    frames = len({one.frame for one in found.seen})
    return {
        "kind": "objects",
        "real": real.name,
        "sensor": model.name,
        "in_short": _in_short(found, model, frames),
        "frames": frames,
        "figures": found.figures,
        "objects": [one.as_json() for one in found.seen],
        "definitions": FIGURES,
        "problems": found.problems,
        "notes": found.notes,
    }


def _in_short(found: ObjectsReport, model: Sensor, frames: int) -> str:
    said = []
    for row in found.figures:
        if (row["from_m"], row["to_m"]) == (0.0, 80.0) and row["points_ratio"] is not None:
            shape = "" if row["chamfer_m"] is None else f", {100 * row['chamfer_m']:.0f} cm apart"
            said.append(f"{row['class']} ({row['boxes']}) {row['points_ratio']:.2f}{shape}")
    return (
        f"{len(found.seen)} objects in {frames} frames of a {model.name}. Our points over real "
        f"ones and how far apart they are, boxes mended: {'; '.join(said) or 'too few points'}."
    )
