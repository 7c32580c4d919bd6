"""Tracking of detections."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from annotated_types import Interval

from urbantwin.interface.command import command
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Artefact, Summary

if TYPE_CHECKING:
    from urbantwin.detections import Detections

__all__ = ["TrackedObjects", "track"]


@dataclass(frozen=True, eq=False, repr=False)
class TrackedObjects(Artefact):
    """Tracks in a folder of detections; they can be passed as the folder.

    Attributes:
        folder: the folder.
        found: the boxes, each with its track number.
    """

    folder: Path
    found: Detections

    def __repr__(self) -> str:
        """Return the number of tracks, and the folder."""
        return f"{sum(self.counts.values())} tracks ({self.folder})"

    @cached_property
    def counts(self) -> dict[str, int]:
        """Number of tracks of each class."""
        pairs = set(zip(self.found.track.tolist(), self.found.class_names, strict=True))
        names = [name for _, name in pairs]
        return {name: names.count(name) for name in sorted(set(names))}

    def summary(self) -> Summary:
        """Return the numbers of tracks and boxes."""
        filled = 0 if self.found.filled is None else int(self.found.filled.sum())
        return Summary(
            path=str(self.folder),
            frames=len(self.found.frames),
            tracks=sum(self.counts.values()),
            boxes=len(self.found),
            filled=filled,
            classes=self.counts,
        )


@command
def track(
    detections: AnyPath,
    out: AnyPath | None = None,
    *,
    frames: AnyPath | None = None,
    rate: Annotated[float | None, Interval(ge=0.1, le=1000)] = None,
    smooth: bool = False,
    gap: Annotated[float, Interval(ge=0, le=60)] = 2.0,
    birth: Annotated[float, Interval(ge=0, le=1)] = 0.3,
    lowest: Annotated[float, Interval(ge=0, le=1)] = 0.1,
    progress: ShowProgress = True,
) -> TrackedObjects:
    """Track road users through detections.

    A track has one class and size; gaps are filled and marked.

    Args:
        detections: folder of detections, of UrbanTwin or in another format (see
            ``model evaluate``).
        out: folder to write; one beside the detections if not given.
        frames: recording, for poses of a sensor mounted on a vehicle and for frame times.
        rate: frames per second, Hz; as the detections say if not given.
        smooth: also use later frames: join broken tracks, smooth positions and headings.
        gap: longest time without a detection, seconds.
        birth: lowest score to start a track.
        lowest: lowest score of a detection that is used.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: the detections cannot be used, or frame times are unknown.

    Example:
        $ urbantwin model track detections/ -o tracked/ --rate 10
    """
    from urbantwin.detections import check_detections_folder, write_detections
    from urbantwin.detections.forms import read_any_form
    from urbantwin.fidelity.readers import open_recording
    from urbantwin.progress import between
    from urbantwin.tracking import Linking, tracked
    from urbantwin.tracking.moments import moments, poses_of

    source = Path(detections)
    target = beside(source, "tracked") if out is None else Path(out)
    recording = None if frames is None else Path(frames)
    inputs = [source, recording]
    check_detections_folder(target, inputs)
    how = Linking(birth=birth, lowest=lowest, gap_s=gap)
    with shown_stage("track", progress, brief=True) as tell:
        opens = None if recording is None else partial(open_recording, recording)
        found, _ = read_any_form(source, opens)
        times = moments(found, source, rate=rate, frames=recording)
        poses = None
        if recording is not None:
            poses = poses_of(found, recording, between(tell, 0.0, 0.5))
        begin = 0.0 if recording is None else 0.5
        told = tracked(
            found, times, poses=poses, how=how, smooth=smooth, tell=between(tell, begin, 0.95)
        )
        settings = {"gap_s": gap, "birth": birth, "lowest": lowest, "smooth": smooth}
        made_by = {"urbantwin": "track", "rides": poses is not None, **settings}
        write_detections(target, told, made_by, inputs)
    return TrackedObjects(target, told)
