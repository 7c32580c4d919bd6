"""Export of shown content as a recording of rerun (https://rerun.io)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.artefact import check_file, replaced_file
from urbantwin.errors import InputError
from urbantwin.extras import check_extra
from urbantwin.progress import Progress, untold
from urbantwin.taxonomy import BOX_SEMANTICS, semantic_classes
from urbantwin.web.shown import Shown

__all__ = ["check_rerun_file", "write_rerun"]


def check_rerun_file(path: Path, inputs: Sequence[Path | None] = ()) -> None:
    """Refuse a recording that cannot be written, before any work.

    Raises:
        InputError: rerun is not installed, or the place cannot be written.
    """
    if path.suffix != ".rrd":
        raise InputError("is not a name of a recording", file=path, expected="NAME.rrd")
    check_extra("rerun", "writing a recording for rerun", place="rerun")
    check_file(path, kind="rerun", inputs=list(inputs))


def write_rerun(
    shown: Shown, path: Path, *, inputs: Sequence[Path | None] = (), tell: Progress = untold
) -> int:
    """Write points, boxes and sensors of every frame on a time line; return the file's size.

    Args:
        shown: content to write.
        path: the ``.rrd`` file.
        inputs: input files and folders.
        tell: called with the fraction done and a description.

    Raises:
        InputError: rerun is not installed, or the path cannot be written.
    """
    check_rerun_file(path, inputs)
    import rerun as rr

    table = np.full((1 << 16, 3), 150, np.uint8)
    for one in semantic_classes().values():
        table[one.id] = one.colour
    with replaced_file(path, kind="rerun", inputs=list(inputs)) as file:
        stream = rr.RecordingStream("urbantwin", recording_id=shown.title)
        stream.save(str(file))
        stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for sensor in shown.sensors:
            pose = np.array(sensor["pose"]).reshape(4, 4)
            place = rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3])
            stream.log(f"sensors/{sensor['name']}", place, static=True)
        for number, side in enumerate(shown.sides):
            for index, entry in enumerate(side.entries):
                tell(index / len(side.entries), f"frame {entry.name}")
                stream.set_time("time", duration=entry.time_s)
                stream.set_time("frame", sequence=index)
                name = side.role if len(shown.sides) > 1 else "frame"
                try:
                    _log(stream, rr, f"{name}", shown, number, index, table)
                except InputError as error:
                    stream.log(f"{name}/problem", rr.TextLog(str(error), level="ERROR"))
        stream.flush()
        stream.disconnect()
    return path.stat().st_size


def _log(
    stream: Any,  # noqa: ANN401
    rr: Any,  # noqa: ANN401
    name: str,
    shown: Shown,
    number: int,
    index: int,
    table: Any,  # noqa: ANN401
) -> None:
    side = shown.sides[number]
    if side.has_points:
        frame = side.frame(index)
        colours = None
        if frame.semantic is not None:
            colours = table[np.clip(frame.semantic, 0, len(table) - 1)]
        elif frame.intensity is not None:
            share = np.clip(frame.intensity / side.full_scale, 0, 1) * 255
            colours = np.repeat(share.astype(np.uint8)[:, None], 3, axis=1)
        stream.log(f"{name}/points", rr.Points3D(frame.points, colors=colours, radii=0.03))
    boxes = side.boxes(index)
    if not len(boxes):
        stream.log(f"{name}/boxes", rr.Clear(recursive=False))
        return
    half = boxes.box[:, 6] / 2
    zero = np.zeros(len(boxes))
    stream.log(
        f"{name}/boxes",
        rr.Boxes3D(
            centers=boxes.box[:, :3],
            half_sizes=boxes.box[:, 3:6] / 2,
            quaternions=np.column_stack([zero, zero, np.sin(half), np.cos(half)]),
            labels=[
                f"{kind} {track}" if track >= 0 else kind
                for kind, track in zip(boxes.class_names, boxes.track.tolist(), strict=True)
            ],
            colors=[
                semantic_classes()[BOX_SEMANTICS.get(kind, "other-object")].colour
                for kind in boxes.class_names
            ],
            show_labels=False,
        ),
    )
