"""Vehicles, riders and pedestrians observed in unlabelled frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from annotated_types import Interval

from urbantwin.artefact import check_folder
from urbantwin.errors import InputError
from urbantwin.interface.command import command
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage, tell_result
from urbantwin.interface.summary import Artefact, Summary

if TYPE_CHECKING:
    from urbantwin.traffic.observed import Observation
    from urbantwin.traffic.observed.box_fit import DetectedActor

__all__ = ["ObservedTraffic", "observe"]


@dataclass(frozen=True, eq=False, repr=False)
class ObservedTraffic(Artefact):
    """Moving and waiting actors of a recording; it can be passed as its file of tracks.

    Attributes:
        folder: folder with ``tracks.csv``, ``proposal.geojson``, ``above.png``.
        found: the tracks.
        counts: number, waiting number and speed of each class.
        spacing: frames that are followed by a gap; empty if none.
    """

    folder: Path
    found: Observation
    counts: dict[str, Any]
    spacing: dict[str, Any]

    def __fspath__(self) -> str:
        """Return the path of the tracks' file."""
        return str(self.folder / "tracks.csv")

    def __repr__(self) -> str:
        """Return the classes and the folder."""
        each = ", ".join(f"{name} {row['tracks']}" for name, row in self.counts.items())
        return f"Traffic observed in {self.found.frames} frames: {each or 'none'} ({self.folder})"

    def summary(self) -> Summary:
        """Return the counts."""
        told = {"spacing": self.spacing} if self.spacing else {}
        return Summary(path=str(self.folder), frames=self.found.frames, **told, **self.counts)


def detected_actors(folder: Path, names: Sequence[str]) -> list[list[DetectedActor]]:
    """Return the detected pedestrians and riders of each frame, by the frames' names.

    Raises:
        InputError: the folder holds no detections, or a frame is missing.
    """
    from urbantwin.detections import read_detections
    from urbantwin.traffic.observed.box_fit import DETECTED, LEAST_SCORE, DetectedActor

    found = read_detections(folder)
    number = {Path(name).stem: index for index, name in enumerate(found.frames)}
    for name in names:
        if name not in number:
            raise InputError(
                f"frame {name} was not looked at",
                file=folder,
                expected="what `urbantwin model detect FRAMES` wrote of the same frames",
            )
    rows = [
        row
        for row, name in enumerate(found.class_names)
        if name in DETECTED and found.score[row] >= LEAST_SCORE
    ]
    by_frame: list[list[DetectedActor]] = [[] for _ in found.frames]
    for row in rows:
        x, y, _, length, width, height, yaw = found.box[row].tolist()
        actor = DetectedActor(
            found.class_names[row],
            np.array([x, y]),
            yaw,
            (length, width, height),
            float(found.score[row]),
        )
        by_frame[found.frame[row]].append(actor)
    return [by_frame[number[name]] for name in names]


@command
def observe(
    frames: AnyPath,
    out: AnyPath | None = None,
    *,
    twin: AnyPath | None = None,
    detections: AnyPath | None = None,
    rate: Annotated[float, Interval(ge=0.1, le=50)] = 10.0,
    times: AnyPath | None = None,
    progress: ShowProgress = True,
) -> ObservedTraffic:
    """Find road users in unlabelled frames, as tracks.

    The sensors must be static.

    Args:
        frames: folder that ``rig discover --frames`` wrote.
        out: folder to write; one beside the frames if not given.
        twin: twin of the place, in the points' frame, to also find vehicles that wait on its lanes.
        detections: detections in these frames (``model detect``), as source of pedestrians and
            riders.
        rate: frames per second, Hz; gaps are found from the motion.
        times: table with ``frame`` and ``seconds``, the time of each frame; replaces ``rate``.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: too few frames, or an input cannot be used.

    Example:
        $ urbantwin traffic observe rings/ -o observed/ --rate 10
    """
    from urbantwin.artefact import replaced_folder, write_json
    from urbantwin.drawing.observed_place import draw_observed_place
    from urbantwin.reconstruct.recording import RecordedFrames
    from urbantwin.traffic.observed import observe as observed
    from urbantwin.traffic.observed import (
        read_frame_times,
        spacing_summary,
        spacing_warnings,
        write_observation,
    )
    from urbantwin.twin import load_twin

    source = Path(frames)
    target = beside(source, "observation") if out is None else Path(out)
    found_by = None if detections is None else Path(detections)
    table = None if times is None else Path(times)
    inputs = [source, None if twin is None else Path(twin), found_by, table]
    check_folder(target, kind="observation", inputs=inputs)
    recording = RecordedFrames(source)
    detected = None if found_by is None else detected_actors(found_by, recording.names)
    moments = None if table is None else read_frame_times(table, recording.names)
    network = None if twin is None else load_twin(Path(twin)).roads
    with shown_stage("observe", progress) as tell:
        found = observed(
            recording, network, detected=detected, rate_hz=rate, times=moments, tell=tell
        )
        spacing = spacing_summary(found.times, recording.names)
        with replaced_folder(target, kind="observation", inputs=inputs) as folder:
            counts = write_observation(folder, found)
            draw_observed_place(folder, found)
            stand = np.round([one.place[:2] for one in recording.sensors], 3).tolist()
            told = {"frames": found.frames, "rate_hz": rate, "sensors": stand, "classes": counts}
            if spacing or moments is not None:
                told["times_s"] = found.times.time_s.round(6).tolist()
                told["groups"] = found.times.group().tolist()
            if spacing:
                told["spacing"] = spacing
            write_json(folder / "observation.json", {"kind": "observation", **told})
    tell_result("observe", target, spacing_warnings(found.times), progress)
    return ObservedTraffic(target, found, counts, spacing)
