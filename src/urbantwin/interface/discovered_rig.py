"""Discovery of the sensors that recorded given frames, with their poses."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.artefact import check_file, check_folder
from urbantwin.interface.command import command
from urbantwin.interface.place import AnyPath
from urbantwin.interface.stage import ShowProgress, shown_stage, tell_result
from urbantwin.interface.summary import Artefact, Summary

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from urbantwin.fidelity.discovery import Discovery

__all__ = ["DiscoveredRig", "discover"]


@dataclass(frozen=True, eq=False, repr=False)
class DiscoveredRig(Artefact):
    """The rig of recorded frames, found from their points; it can be passed as its file.

    Attributes:
        path: the written ``rig.yaml``.
        picture: picture of points by sensor, and of elevations against channels.
        found: the sensors, with standard deviations.
        written: paths of the sensors' files beside the rig, and the number of frames with rings.
    """

    path: Path
    picture: Path
    found: Discovery
    written: dict[str, Any]

    def __repr__(self) -> str:
        """Return the sensors and the file."""
        each = ", ".join(" or ".join(one.models) or "unknown" for one in self.found.sensors)
        return f"Rig of {len(self.found.sensors)} sensors discovered: {each} ({self.path})"

    def summary(self) -> Summary:
        """Return the sensors in brief."""
        told = {**self.found.report(), "warnings": [str(one) for one in self.found.warnings]}
        return Summary(path=str(self.path), picture=str(self.picture), **told, **self.written)

    def plot(self) -> Figure:
        """Show points by sensor, and elevations against channels."""
        from urbantwin.drawing.style import figure_of_picture

        return figure_of_picture(self.picture)


@command
def discover(
    real: AnyPath,
    out: AnyPath | None = None,
    *,
    frames: AnyPath | None = None,
    picture: AnyPath | None = None,
    overwrite: bool = False,
    progress: ShowProgress = True,
) -> DiscoveredRig:
    """Find the sensors that recorded unlabelled frames.

    Finds their positions, tilts and models.

    Args:
        real: frames of static sensors, fused or of one sensor; or one frame.
        out: rig to write; ``discovered_rig.yaml`` here if not given.
        frames: folder to write all frames to, with sensor, ring and column of every point.
        picture: PNG to write; beside the rig if not given.
        overwrite: replace a file that urbantwin did not write, or that was changed or made
            read-only.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: no sensor is found (with the reason), or an input cannot be used.

    Example:
        $ urbantwin rig discover real/ -o rig.yaml --frames rings/
    """
    from urbantwin.fidelity.discovery import discover_recording

    target = Path(out or "discovered_rig.yaml")
    drawn = target.with_suffix(".png") if picture is None else Path(picture)
    folder = None if frames is None else Path(frames)
    check_file(target, kind="discover", inputs=[Path(real)])
    check_file(drawn, kind="discover picture", inputs=[Path(real)])
    if folder is not None:
        check_folder(folder, kind="discovery", inputs=[Path(real)])
    with shown_stage("discover", progress) as tell:
        found, written = discover_recording(Path(real), target, drawn, folder, tell)
    tell_result("discover", target, found.warnings, progress)
    return DiscoveredRig(target, drawn, found, written)
