"""Where in a twin a real sensor stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from urbantwin.artefact import check_file
from urbantwin.fidelity.alignment import Alignment, Wish, align_rig, frame_numbers
from urbantwin.interface.overwrite import may_overwrite
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.rig import rig_on
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Summary
from urbantwin.interface.twin import Twin

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["AlignedRig", "align"]


@dataclass(frozen=True, eq=False, repr=False)
class AlignedRig:
    """A rig whose sensors stand where real frames show that they do; it stands for its file.

    Attributes:
        path: the ``rig.yaml`` that was written.
        picture: of the points over the twin, before and after.
        found: the pose, and how far it can be trusted.
    """

    path: Path
    picture: Path
    found: Alignment

    def __fspath__(self) -> str:
        """Return the rig's file."""
        return str(self.path)

    def __repr__(self) -> str:
        """Return the place, its accuracy and the file."""
        told = self.found.report()
        return (
            f"Rig aligned at {told['east_m']:.2f} m east, {told['north_m']:.2f} m north, "
            f"{told['up_m']:.2f} m up, heading {told['yaw_deg']:.2f} degrees: residual "
            f"{told['residual_m']:.3f} m, confidence {told['confidence']:.2f} ({self.path})"
        )

    def summary(self) -> Summary:
        """Return the pose and its accuracy in a few values."""
        return Summary(path=str(self.path), picture=str(self.picture), **self.found.report())

    def plot(self) -> Figure:
        """Show the points over the twin, before and after."""
        from urbantwin.view.style import figure_of_picture

        return figure_of_picture(self.picture)


@may_overwrite
def align(  # noqa: PLR0913 - the options of the command
    real: AnyPath,
    twin: Twin | AnyPath,
    out: AnyPath | None = None,
    *,
    rig: AnyPath | None = None,
    sensor: str | None = None,
    frames: str | Sequence[int] = "0",
    guess: tuple[float, float, float] | None = None,
    anywhere: bool = False,
    within: tuple[float, float] = (3.0, 15.0),
    level: bool = False,
    picture: AnyPath | None = None,
    overwrite: bool = False,
    progress: ShowProgress = True,
) -> AlignedRig:
    """Find the pose of a sensor in a twin from real frames, and write it into a rig.

    Args:
        real: a real frame, or a recording of them.
        twin: the twin, or its folder.
        out: the rig to write; ``aligned_rig.yaml`` beside the twin when not given.
        rig: the rig whose first sensor it is; the twin's own if not given.
        sensor: name of the sensor that recorded, which alone moves; else it is the first, and
            others move with it.
        frames: numbers of frames from 0, or ``all``; their mean pose is taken.
        guess: roughly where: metres east and north of the anchor, degrees from east; as the rig
            says if not given.
        anywhere: search the whole region, with any heading.
        within: how far off the rough place (metres) and heading (degrees) may be.
        level: the points are level with gravity; the rig says the tilt.
        picture: the PNG to write; beside the rig if not given.
        overwrite: replace a file that urbantwin did not write, or that was changed since, or is
            read-only.
        progress: show how far it is; or a function that is told (share, doing).

    Raises:
        InputError: the place is not found, or what is given cannot be used.
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
