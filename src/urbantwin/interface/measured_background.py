"""What stands still, measured beam by beam from the frames of fixed sensors."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.artefact import check_file
from urbantwin.errors import InputError
from urbantwin.interface.overwrite import may_overwrite
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Summary

if TYPE_CHECKING:
    from urbantwin.fidelity.waiting_traffic import WaitingTraffic
    from urbantwin.interface.twin import Twin
    from urbantwin.lidar.background import MeasuredBackground

__all__ = ["Background", "background"]


@dataclass(frozen=True, eq=False, repr=False)
class Background:
    """Measured backgrounds of sensors; it stands for its file: ``ut.record(background=...)``.

    Attributes:
        path: the ``.npz``.
        told: what the measurement said of itself; empty of a file that was opened.
    """

    path: Path
    told: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def open(cls, path: AnyPath) -> Background:
        """Open a file.

        Raises:
            InputError: it is missing, damaged or something else.
        """
        found = cls(Path(path))
        assert found.sensors is not None  # read now, so that a bad file is told now
        return found

    @cached_property
    def sensors(self) -> list[MeasuredBackground]:
        """Images of each sensor, channels by columns: ``range_m``, ``sigma_m``, ``share``, ..."""
        from urbantwin.lidar.background_file import load_backgrounds

        return load_backgrounds(self.path)

    def __fspath__(self) -> str:
        """Return the file."""
        return str(self.path)

    def __repr__(self) -> str:
        """Return each sensor's share of beams with a range, and the file."""
        each = ", ".join(
            f"{one.name or one.model or 'a sensor'} with {one.known.mean():.0%} of "
            f"{one.shape[0]} x {one.shape[1]} beams"
            for one in self.sensors
        )
        return f"Background measured by {each} ({self.path})"

    def summary(self) -> Summary:
        """Return what was measured in a few values."""
        return Summary(path=str(self.path), **self.told)


@may_overwrite
def background(  # noqa: PLR0913 - the options of the command
    real: AnyPath,
    out: AnyPath | None = None,
    *,
    sensor: str | None = None,
    columns: int | None = None,
    rate: float | None = None,
    pose: tuple[float, float, float, float, float, float] | None = None,
    twin: Twin | AnyPath | None = None,
    rig: AnyPath | None = None,
    only: str | None = None,
    points_in: str | None = None,
    elevations: AnyPath | None = None,
    intensity_scale: float | None = None,
    interval: float | None = None,
    traffic: bool = False,
    overwrite: bool = False,
    progress: ShowProgress = True,
) -> Background:
    """Measure the static world beam by beam from unlabelled frames, for `record`.

    Args:
        real: frames of sensors that stand still; or a matrix of ranges.
        out: the ``.npz`` to write; ``background.npz`` beside the twin, or here without one, when
            not given.
        sensor: a model of the catalogue, or a sensor's file.
        columns: its columns per turn; the model's default if not given.
        rate: its turns per second.
        pose: x, y, z, yaw, pitch, roll of the sensor in the frame of the points, metres and
            degrees; without it the points are in the sensor's own.
        twin: a twin whose rig's sensors they are, in place of ``sensor``.
        rig: with ``twin``: a ``rig.yaml``; the twin's own if not given.
        only: with ``twin``: name of the sensor that recorded alone.
        points_in: with ``twin``: ``sensor``, ``level`` or ``site``; as the rig says if not given.
        elevations: a file with those of a matrix's rows, degrees or radians.
        intensity_scale: what the data call full scale of intensity; guessed if not given.
        interval: seconds from one frame to the next; a turn if not given. How long what stirs
            stays as it is, is told by it.
        traffic: with ``twin``: keep what waited on its lanes in all frames.
        overwrite: replace a file that urbantwin did not write, or that was changed since, or is
            read-only.
        progress: show how far it is; or a function that is told (share, doing).

    Raises:
        InputError: neither or both of ``sensor`` and ``twin`` are given, or something given
            cannot be used.
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
