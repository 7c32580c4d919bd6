"""Recorded traffic: tracks replayed on a twin, or used to calibrate its traffic."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import Ge, Interval

from urbantwin.artefact import check_folder
from urbantwin.interface.command import command
from urbantwin.interface.motion import Motion
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage, tell_result
from urbantwin.interface.summary import Artefact, Summary
from urbantwin.interface.twin import Twin

if TYPE_CHECKING:
    from urbantwin.traffic.motion import Motion as DrivenMotion

__all__ = ["Calibration", "calibrate", "replay"]


@command
def replay(
    tracks: AnyPath,
    out: AnyPath | None = None,
    *,
    twin: Twin | AnyPath,
    step: Annotated[float | None, Interval(ge=0.001, le=10)] = None,
    smooth: bool = True,
    keep_clock: bool = False,
    keep_names: bool = False,
    pictures: bool = True,
    progress: ShowProgress = True,
) -> Motion:
    """Turn recorded tracks into a twin's motion.

    The tracks are resampled, smoothed and placed on the twin's ground.

    Args:
        tracks: description of recorded tracks (YAML, docs/howto/recorded_traffic.md), or the
            tracks: CSV, OpenLABEL or nuScenes JSON, KITTI labels, OpenSCENARIO.
        twin: twin that they move on, or its folder.
        out: folder to write, in which an older motion is replaced; ``motion`` beside the twin if
            not given.
        step: time step, seconds; the site's ``traffic.step_s`` if not given.
        smooth: smooth the noise of the paths.
        keep_clock: store the recording's time of day at its start in the motion.
        keep_names: store the recording's name of each actor in the motion, even if it is not a
            number.
        pictures: draw the paths of the actors into the motion's folder.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: the tracks, the twin or ``out`` cannot be used; names the row of the tracks.

    Example:
        >>> motion = ut.traffic.replay("tracks.yaml", twin="twin/")
        $ urbantwin traffic replay tracks.csv --twin urbantwin-demo/twin -o motion/
    """
    from urbantwin.traffic.recorded.read import files_of
    from urbantwin.traffic.replay import replay as replayed

    place, described = beside(twin, "motion", out), Path(tracks)
    check_folder(place, kind="motion", inputs=[Path(twin), *files_of(described)])
    loaded = Twin.open(twin)

    def draw(driven: DrivenMotion, folder: Path) -> None:
        from urbantwin.drawing.pictures import picture_of_motion

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
class Calibration(Artefact):
    """Calibration of a site's traffic to a recording; it can be passed as its folder.

    Attributes:
        folder: folder with ``traffic.yaml``, ``site.yaml`` and ``calibration.json``.
        report: measured values, trials, and agreement of a simulation with the recording.
    """

    folder: Path
    report: dict[str, Any]

    def summary(self) -> Summary:
        """Return the fitted values and their agreement."""
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
                if "approach" not in one and "classes" not in one  # the values of most drivers
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


@command
def calibrate(
    tracks: AnyPath,
    out: AnyPath | None = None,
    *,
    site: AnyPath,
    fit_share: Annotated[float, Interval(ge=0.1, le=1.0)] = 0.6,
    gap: Annotated[float, Ge(0)] = 5.0,
    seconds: Annotated[float, Interval(ge=0, le=86400)] = 3600.0,
    seed: Annotated[int | None, Ge(0)] = None,
    progress: ShowProgress = True,
) -> Calibration:
    """Fit a site's traffic to recorded tracks.

    Demand, drivers and signals are fitted to the first part of the recording and evaluated on the
    rest.

    Args:
        tracks: description of recorded tracks (YAML, docs/howto/recorded_traffic.md), or the
            tracks; or a folder of ``traffic observe``: then only the demand is fitted, to the
            number of actors present, and ``fit_share``, ``gap`` and ``seconds`` have no effect.
        site: the ``site.yaml``.
        out: folder to write: ``traffic.yaml`` for ``drive(demand=...)``, ``site.yaml`` with traffic
            and signals, ``calibration.json``; ``calibrated`` beside the site if not given.
        fit_share: share of the recording to fit to; the rest is for evaluation.
        gap: time between the two parts, seconds.
        seconds: length of the evaluated simulation, seconds; 0 for none.
        seed: random seed of the simulations; 1 if not given.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: the tracks, the site or ``out`` cannot be used; names the row of the tracks.
        StageError: netconvert or SUMO failed.

    Example:
        >>> ut.traffic.calibrate("tracks.yaml", site="site.yaml").report["held_out"]
        $ urbantwin traffic calibrate tracks.csv --site mysite/site.yaml -o calibrated/
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
