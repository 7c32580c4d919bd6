"""Alignment of a real sensor in a twin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from urbantwin.artefact import check_file
from urbantwin.fidelity.alignment import Alignment, Wish, align_rig, frame_numbers
from urbantwin.interface.command import command
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.rig import rig_on
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Artefact, Summary
from urbantwin.interface.twin import Twin

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["AlignedRig", "align"]


@dataclass(frozen=True, eq=False, repr=False)
class AlignedRig(Artefact):
    """A rig with sensor poses found from real frames; it can be passed as its file.

    Attributes:
        path: the written ``rig.yaml``.
        picture: picture of the points over the twin, before and after.
        found: the pose, with its accuracy.
    """

    path: Path
    picture: Path
    found: Alignment

    def __repr__(self) -> str:
        """Return position, accuracy and file."""
        told = self.found.report()
        return (
            f"Rig aligned at {told['east_m']:.2f} m east, {told['north_m']:.2f} m north, "
            f"{told['up_m']:.2f} m up, heading {told['yaw_deg']:.2f} degrees: residual "
            f"{told['residual_m']:.3f} m, confidence {told['confidence']:.2f} ({self.path})"
        )

    def summary(self) -> Summary:
        """Return the pose and its accuracy."""
        return Summary(path=str(self.path), picture=str(self.picture), **self.found.report())

    def plot(self) -> Figure:
        """Show the points over the twin, before and after alignment."""
        from urbantwin.drawing.style import figure_of_picture

        return figure_of_picture(self.picture)


@command
def align(
    real: AnyPath,
    twin: Twin | AnyPath,
    out: AnyPath | None = None,
    *,
    rig: AnyPath | None = None,
    sensor: str | None = None,
    frames: Annotated[str | Sequence[int], "N,N,..."] = "0",
    guess: Annotated[tuple[float, float, float] | None, "EAST NORTH YAW"] = None,
    anywhere: bool = False,
    within: Annotated[tuple[float, float], "M DEG"] = (3.0, 15.0),
    level: bool = False,
    picture: AnyPath | None = None,
    overwrite: bool = False,
    progress: ShowProgress = True,
) -> AlignedRig:
    """Find the pose of a real sensor in a twin.

    Writes the pose into a rig.

    Args:
        real: real frame, or a recording of them.
        twin: twin, or its folder.
        out: rig to write; ``aligned_rig.yaml`` beside the twin if not given.
        rig: rig whose first sensor it is; the twin's own if not given.
        sensor: name of the recording sensor, which alone is moved; if not given, the first, and the
            others move with it.
        frames: numbers of frames from 0, or ``all``; the mean pose is taken.
        guess: approximate position, metres east and north of the anchor, and heading, degrees from
            east; the rig's if not given.
        anywhere: search the whole region, with any heading.
        within: largest deviation from the approximate position (metres) and heading (degrees).
        level: the points are level; the tilt is the rig's.
        picture: PNG to write; beside the rig if not given.
        overwrite: replace a file that urbantwin did not write, or that was changed or made
            read-only.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: no pose is found, or an input cannot be used.

    Example:
        $ urbantwin rig align real/ twin/ --guess 12 -7 135 -o rig.yaml
    """
    target = beside(twin, "aligned_rig.yaml", out)
    drawn = target.with_suffix(".png") if picture is None else Path(picture)
    rig_file = None if rig is None else Path(rig)
    inputs = [Path(real), Path(twin), rig_file]
    check_file(target, kind="align", inputs=inputs, replaces=rig_file)
    check_file(drawn, kind="align picture", inputs=inputs)
    loaded = Twin.open(twin)
    source = loaded.rig_path if rig_file is None else rig_file
    placed = rig_on(loaded, rig_file)
    with shown_stage("align", progress) as tell:
        asked = frames if isinstance(frames, str) else ",".join(map(str, frames))
        wish = Wish(guess, anywhere, within, level, frame_numbers(asked), sensor)
        found = align_rig(Path(real), loaded, placed, source, target, wish, tell, drawn)
    return AlignedRig(target, drawn, found)
