"""Measured static world, beam by beam, from frames of fixed sensors."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import Ge

from urbantwin.artefact import check_file
from urbantwin.errors import InputError
from urbantwin.interface.command import command
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Artefact, Summary

if TYPE_CHECKING:
    from urbantwin.fidelity.waiting_traffic import WaitingTraffic
    from urbantwin.interface.twin import Twin
    from urbantwin.lidar.background import MeasuredBackground

__all__ = ["Background", "background"]


@dataclass(frozen=True, eq=False, repr=False)
class Background(Artefact):
    """Measured backgrounds of sensors; can be passed as its file: ``ut.record(background=...)``.

    Attributes:
        path: the ``.npz`` file.
        told: report of the measurement; empty for an opened file.
    """

    path: Path
    told: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def open(cls, path: AnyPath) -> Background:
        """Open a file.

        Raises:
            InputError: the file is missing, damaged or of another kind.
        """
        found = cls(Path(path))
        assert found.sensors is not None  # read now to report errors at once
        return found

    @cached_property
    def sensors(self) -> list[MeasuredBackground]:
        """Images of each sensor, channels by columns: ``range_m``, ``sigma_m``, ``share``, ..."""
        from urbantwin.lidar.background_file import load_backgrounds

        return load_backgrounds(self.path)

    def __repr__(self) -> str:
        """Return each sensor's share of beams with a range, and the file."""
        each = ", ".join(
            f"{one.name or one.model or 'a sensor'} with {one.known.mean():.0%} of "
            f"{one.shape[0]} x {one.shape[1]} beams"
            for one in self.sensors
        )
        return f"Background measured by {each} ({self.path})"

    def summary(self) -> Summary:
        """Return the path and the measurement's report."""
        return Summary(path=str(self.path), **self.told)


@command
def background(
    real: AnyPath,
    out: AnyPath | None = None,
    *,
    sensor: Annotated[str | None, "MODEL"] = None,
    columns: Annotated[int | None, Ge(1)] = None,
    rate: Annotated[float | None, Ge(0.1)] = None,
    pose: Annotated[
        tuple[float, float, float, float, float, float] | None, "X Y Z YAW PITCH ROLL"
    ] = None,
    twin: Twin | AnyPath | None = None,
    rig: AnyPath | None = None,
    only: str | None = None,
    points_in: Annotated[str | None, "FRAME"] = None,
    elevations: AnyPath | None = None,
    intensity_scale: float | None = None,
    interval: Annotated[float | None, Ge(0.001)] = None,
    traffic: bool = False,
    overwrite: bool = False,
    progress: ShowProgress = True,
) -> Background:
    """Measure the static world, beam by beam.

    Uses unlabelled frames of static sensors; the result is for ``record --background``.

    Args:
        real: frames of static sensors, or a matrix of ranges.
        out: ``.npz`` to write; ``background.npz`` beside the twin, or here without one, if not
            given.
        sensor: model of the catalogue, or a sensor's file.
        columns: columns per turn; the model's default if not given.
        rate: turns per second, Hz; the model's default if not given.
        pose: pose of the sensor in the points' frame, metres and degrees; if not given, the points
            are in the sensor's frame.
        twin: twin whose rig recorded the frames; replaces ``sensor``.
        rig: with ``twin``: ``rig.yaml``; the twin's own if not given.
        only: with ``twin``: name of the only sensor that recorded.
        points_in: with ``twin``: frame of the points, ``sensor``, ``level`` or ``site``; as the rig
            says if not given.
        elevations: file with the elevations of a matrix's rows, degrees or radians.
        intensity_scale: full scale of the data's intensity; estimated if not given.
        interval: time from one frame to the next, seconds; one turn if not given. Gives the
            correlation time of moving foliage.
        traffic: with ``twin``: keep objects that stood on its lanes in all frames.
        overwrite: replace a file that urbantwin did not write, or that was changed or made
            read-only.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: neither or both of ``sensor`` and ``twin`` are given, or an input cannot be
            used.

    Example:
        $ urbantwin rig background real/ --sensor OS1-128 -o measured.npz
    """
    from urbantwin.fidelity.background_estimation import measure_recording
    from urbantwin.fidelity.beam_assignment import beams_of_model, beams_of_rig
    from urbantwin.fidelity.range_matrix import is_matrix, measure_matrix
    from urbantwin.interface.rig import rig_on
    from urbantwin.interface.twin import Twin

    if (sensor is None) == (twin is None):
        raise InputError("which sensor is it?", expected="--sensor or --twin, and not both")
    target = Path(out or "background.npz") if twin is None else beside(twin, "background.npz", out)
    given = [None if one is None else Path(one) for one in (real, twin, rig, elevations)]
    frames, _, rig_file, table = given
    assert frames is not None
    check_file(target, kind="background", inputs=given)
    waits: list[WaitingTraffic] = []
    if twin is not None:
        on = Twin.open(twin)
        placed = rig_on(on, rig_file)
        beams = beams_of_rig(placed, only=only, frame=points_in)
        if not traffic and not is_matrix(frames):
            from urbantwin.fidelity.waiting_traffic import WaitingTraffic

            poses = {one.name: one.site_SE3_sensor for one in placed.sensors}
            waits = [WaitingTraffic(on, poses[one.name]) for one in beams]
    else:
        assert sensor is not None
        beams = [beams_of_model(sensor, columns=columns, turns_per_second=rate, pose=pose)]
    with shown_stage("background", progress) as tell:
        if is_matrix(frames):
            told = measure_matrix(frames, beams[0], target, elevations=table)
        else:
            told = measure_recording(
                frames,
                beams,
                target,
                intensity_scale=intensity_scale,
                waits=waits,
                interval_s=interval,
                progress=tell,
            )
    return Background(target, told)
