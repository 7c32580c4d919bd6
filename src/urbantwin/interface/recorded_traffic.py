"""Recorded traffic: tracks that are replayed on a twin, or that its traffic is calibrated to."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.artefact import check_folder
from urbantwin.interface.motion import Motion
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage, tell_result
from urbantwin.interface.summary import Summary
from urbantwin.interface.twin import Twin

if TYPE_CHECKING:
    from urbantwin.traffic.motion import Motion as DrivenMotion

__all__ = ["Calibration", "calibrate", "replay"]


def replay(  # noqa: PLR0913 - the options of the command
    tracks: AnyPath,
    twin: Twin | AnyPath,
    out: AnyPath | None = None,
    *,
    step: float | None = None,
    smooth: bool = True,
    keep_clock: bool = False,
    keep_names: bool = False,
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
        keep_clock: note in the motion what the recording's clock said at its start: a time of day.
        keep_names: note in the motion what the recording calls each actor, also where that is no
            number.
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
            keep_clock=keep_clock,
            keep_names=keep_names,
            also=draw if pictures else None,
            progress=tell,
        )
    tell_result("replay", place, made.warnings, progress)
    return Motion.of(made, place)


@dataclass(frozen=True, eq=False)
class Calibration:
    """What a recording told of a site's traffic; it stands for its folder.

    Attributes:
        folder: with ``traffic.yaml``, ``site.yaml`` and ``calibration.json``.
        report: what was measured, what was tried, and how well a simulation agrees with it.
    """

    folder: Path
    report: dict[str, Any]

    def __fspath__(self) -> str:
        """Return the folder."""
        return str(self.folder)

    def summary(self) -> Summary:
        """Return what was found in a few values."""
        told = self.report
        if "demand" in told:
            return Summary(
                path=str(self.folder), recorded_s=told["recorded_s"], demand=told["demand"]
            )
        return Summary(
            path=str(self.folder),
            fitted_s=told["fitted_s"],
            vehicles=sum(row["count"] for row in told["measured"]["turns"]),
            signals=told["signals"]
            and {name: told["signals"].get(name) for name in ("cycle_s", "green_s", "actuated")},
            drivers={
                one["field"]: one["value"]
                for one in told["drivers"]
                if "approach" not in one and "classes" not in one  # those of most
            },
            not_told=told["not_told"],
            **{
                name: told[name]
                for name in (
                    "fitted",
                    "held_out",
                    "by_chance_held_out",
                    "held_out_in_the_same_part_of_the_cycle",
                    "recording_with_itself_held_out",
                    "simulation_with_itself_held_out",
                )
                if name in told
            },
        )


def calibrate(
    tracks: AnyPath,
    site: AnyPath,
    out: AnyPath | None = None,
    *,
    fit_share: float = 0.6,
    gap: float = 5.0,
    seconds: float = 3600.0,
    seed: int | None = None,
    progress: ShowProgress = True,
) -> Calibration:
    """Fit a site's demand, drivers and signals to recorded tracks, and judge by the rest of them.

    Args:
        tracks: a description of recorded tracks (YAML), or the tracks themselves; or a folder that
            ``ut.observe`` wrote: then the demand alone is fitted, to how many are present, and
            ``fit_share``, ``gap`` and ``seconds`` do not count.
        site: the ``site.yaml``.
        out: the folder to write: ``traffic.yaml`` for ``drive(demand=...)``, ``site.yaml`` with
            traffic and signals, ``calibration.json``; ``calibrated`` beside the site when not
            given.
        fit_share: share of the recording that is fitted to, 0.1 to 1; what comes later judges.
        gap: seconds between the two parts.
        seconds: length of the simulation that is judged, up to 86400; 0 simulates nothing.
        seed: of the simulations; 1 if not given.
        progress: show how far it is; or a function that is told (share, doing).

    Raises:
        InputError: the tracks, the site or ``out`` cannot be used; a row of the tracks is named.
        StageError: netconvert or SUMO failed.

    Example:
        >>> ut.calibrate("tracks.yaml", "site.yaml", "calibrated/").report["held_out"]
    """
    from urbantwin.traffic.calibration import calibrate_observation, calibrate_traffic
    from urbantwin.traffic.observed import is_observation

    place = Path(site).parent / "calibrated" if out is None else Path(out)
    with shown_stage("calibrate", progress) as tell:
        if is_observation(Path(tracks)):
            report = calibrate_observation(
                Path(tracks), Path(site), place, seed=1 if seed is None else seed, progress=tell
            )
            return Calibration(place, report)
        report = calibrate_traffic(
            Path(tracks),
            Path(site),
            place,
            fit_share=fit_share,
            gap_s=gap,
            seconds=seconds,
            seed=1 if seed is None else seed,
            progress=tell,
        )
    return Calibration(place, report)
