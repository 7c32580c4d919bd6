"""Recorded traffic: tracks that are replayed on a twin."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from urbantwin.artefact import check_folder
from urbantwin.interface.motion import Motion
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage, tell_result
from urbantwin.interface.twin import Twin

if TYPE_CHECKING:
    from urbantwin.traffic.motion import Motion as DrivenMotion

__all__ = ["replay"]


def replay(
    tracks: AnyPath,
    twin: Twin | AnyPath,
    out: AnyPath | None = None,
    *,
    step: float | None = None,
    smooth: bool = True,
    pictures: bool = True,
    progress: ShowProgress = True,
) -> Motion:
    """Make a motion of recorded tracks: resampled, smoothed, on the twin's ground.

    Args:
        tracks: a description of recorded tracks (YAML), or the tracks themselves: CSV, OpenLABEL
            or nuScenes JSON, KITTI labels, OpenSCENARIO.
        twin: the twin that they move on, or its folder.
        out: the folder to write, in which an older motion is replaced; ``motion`` beside the twin
            when not given.
        step: seconds between steps, 0.001 to 10; the site's ``traffic.step_s`` if not given.
        smooth: take the noise off their paths.
        pictures: draw the paths of the actors into the motion's folder.
        progress: show how far it is; or a function that is told (share, doing).

    Raises:
        InputError: the tracks, the twin or ``out`` cannot be used; a row of the tracks is named.

    Example:
        >>> motion = ut.replay("tracks.yaml", "twin/")
    """
    from urbantwin.traffic.recorded.read import files_of
    from urbantwin.traffic.replay import replay as replayed

    place, described = beside(twin, "motion", out), Path(tracks)
    check_folder(place, kind="motion", inputs=[Path(twin), *files_of(described)])
    loaded = Twin.open(twin)

    def draw(driven: DrivenMotion, folder: Path) -> None:
        from urbantwin.view.pictures import picture_of_motion

        (folder / "pictures").mkdir()
        picture_of_motion(driven, loaded, folder / "pictures" / "paths.png")

    with shown_stage("replay", progress) as tell:
        made = replayed(
            loaded,
            described,
            place,
            step_s=step,
            smooth=smooth,
            also=draw if pictures else None,
            progress=tell,
        )
    tell_result("replay", place, made.warnings, progress)
    return Motion.of(made, place)
