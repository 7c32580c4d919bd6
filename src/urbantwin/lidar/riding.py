"""Rigs mounted on an actor of the motion."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import Pose
from urbantwin.lidar.enclosure import enclosing
from urbantwin.lidar.rig import MountedSensor, Rig

if TYPE_CHECKING:
    from urbantwin.site.rig import RideSpec
    from urbantwin.traffic import Motion

__all__ = ["boarded", "boarded_while_there", "while_there"]

#: A sensor deeper inside its carrier's mesh is rejected, metres: meshes are coarse.
_SKIN_M = 0.1
#: Times that differ by less are equal.
_SAME_TIME_S = 1e-6


def boarded(
    rig: Rig,
    motion: Motion,
    times_s: Sequence[float],
    *,
    fastest_m_s: float = 70.0,
    file: str | None = None,
) -> Rig:
    """Assign a carrier to a rig that is mounted on an actor; other rigs are returned unchanged.

    Args:
        rig: the placed rig.
        motion: the motion.
        times_s: times of the frames, ascending, seconds.
        fastest_m_s: an actor that moves faster between two steps was relocated, which ends its
            presence.
        file: the rig's file, for errors.

    Raises:
        InputError: no such actor, a carrier that is absent in some frames (the error gives the
            interval of its presence), or a sensor inside it.
    """
    if rig.ride is None:
        return rig
    first, last = times_s[0], times_s[-1]
    best = _chosen(_spans(motion, rig.ride, fastest_m_s), rig.ride, motion, (first, last), file)
    if best.start_s > first + _SAME_TIME_S or best.stop_s < last - _SAME_TIME_S:
        on, off = (f"{value:.9g}" for value in (best.start_s, best.stop_s))
        raise InputError(
            f"{best.who}, which carries the rig, is there from {on} to {off} s, and frames from "
            f"{first:g} to {last:g} s are requested",
            file=file,
            place="ride",
            expected=f"--start {on} --stop {off}",
        )
    return _mounted_on(rig, best, motion, file)


def boarded_while_there(
    rig: Rig,
    motion: Motion,
    times_s: Sequence[float],
    *,
    taken: Collection[int] = (),
    fastest_m_s: float = 70.0,
    file: str | None = None,
) -> tuple[Rig, list[tuple[float, float]]]:
    """Assign a carrier that may be absent in some frames.

    Args:
        rig: the placed rig, mounted on an actor.
        motion: the motion.
        times_s: times of the frames, ascending, seconds.
        taken: tracks that carry other rigs; another actor of the class carries this one.
        fastest_m_s: see `boarded`.
        file: the rig's file, for errors.

    Returns:
        The rig, and the intervals of its carrier's presence, seconds, ascending.

    Raises:
        InputError: no such actor, none left, a carrier that is absent in all frames, or a sensor
            inside it.
    """
    assert rig.ride is not None
    frames_s = times_s[0], times_s[-1]
    spans = _spans(motion, rig.ride, fastest_m_s)
    free = [span for span in spans if span.track not in taken]
    if spans and not free:
        who = rig.ride.actor_class or f"track {rig.ride.track}"
        raise InputError(
            f"no {who} is left: each carries a node already",
            file=file,
            place="ride",
            expected="fewer nodes on that class, or a rig with the sensors of both",
        )
    best = _chosen(free, rig.ride, motion, frames_s, file)
    own = [(span.start_s, span.stop_s) for span in spans if span.track == best.track]
    if not while_there(times_s, own).any():
        there = ", ".join(f"{on:.9g} to {off:.9g} s" for on, off in own)
        raise InputError(
            f"{best.who}, which carries the node, is not there in any frame: it is from {there}, "
            f"and frames are from {frames_s[0]:g} to {frames_s[1]:g} s",
            file=file,
            place="ride",
            expected="an actor that is there in the recorded span",
        )
    return _mounted_on(rig, best, motion, file), own


def while_there(
    times_s: Sequence[float], spans: Sequence[tuple[float, float]]
) -> NDArray[np.bool_]:
    """Return the times (T,) within intervals of presence."""
    times = np.asarray(times_s, np.float64)
    there = np.zeros(len(times), np.bool_)
    for start_s, stop_s in spans:
        there |= (times >= start_s - _SAME_TIME_S) & (times <= stop_s + _SAME_TIME_S)
    return there


def _chosen(
    spans: Sequence[_Span],
    ride: RideSpec,
    motion: Motion,
    frames_s: tuple[float, float],
    file: str | None,
) -> _Span:
    """Return the interval of presence with the largest overlap with the recorded frames."""
    if not spans:
        raise _nobody(ride, motion, file)
    return max(spans, key=lambda span: (span.shared(*frames_s), -span.distance_m))


def _mounted_on(rig: Rig, best: _Span, motion: Motion, file: str | None) -> Rig:
    """Mount a rig on its carrier."""
    mesh = motion.mesh(best.asset, best.phase)
    roof_m = float(mesh.vertices[np.unique(mesh.faces), 2].max())
    sensors = tuple(_on_roof(mounted, roof_m) for mounted in rig.sensors)
    for number, mounted in enumerate(sensors):
        assert mounted.carrier_SE3_sensor is not None
        place = mounted.carrier_SE3_sensor.translation
        around = place + _SKIN_M * np.vstack([np.zeros(3), np.eye(3), -np.eye(3)])
        if all(enclosing(point, mesh) for point in around):
            raise InputError(
                f"the sensor is inside {best.who}, which is {roof_m:.2f} m high",
                file=file,
                place=f"sensors[{number}].height_m",
                expected="a place on the outside of its carrier, or above_roof_m",
            )
    return replace(
        rig,
        sensors=sensors,
        carrier=best.track,
    )


@dataclass(frozen=True)
class _Span:
    """An interval without gaps in which an actor is present, ``distance_m`` from the anchor."""

    track: int
    actor_class: str
    asset: str
    phase: int
    start_s: float
    stop_s: float
    distance_m: float

    @property
    def who(self) -> str:
        """Class and track."""
        return f"{self.actor_class} {self.track}"

    def shared(self, start_s: float, stop_s: float) -> float:
        """Return the overlap with another interval, rounded to milliseconds."""
        return round(min(self.stop_s, stop_s) - max(self.start_s, start_s), 3)


def _spans(motion: Motion, ride: RideSpec, fastest_m_s: float) -> list[_Span]:
    """Return the intervals of presence of the possible carriers, by track and time."""
    name, wanted = ("class", ride.actor_class) if ride.track is None else ("track", ride.track)
    chosen = motion.rows.where(name, [wanted])
    if not chosen.num_rows:
        return []
    column: Mapping[str, NDArray[np.float64]] = {
        name: np.asarray(chosen[name].to_numpy()) for name in ("time_s", "track", "x", "y", "z")
    }
    order = np.lexsort((column["time_s"], column["track"]))
    time, tracks = column["time_s"][order], column["track"][order]
    moved = np.linalg.norm(np.diff([column[name][order] for name in "xyz"], axis=1), axis=0)
    wait = np.diff(time)
    apart = np.diff(tracks) != 0
    apart |= (wait > 1.5 * motion.step_s) | (moved > fastest_m_s * motion.step_s)
    starts = np.concatenate([[0], np.flatnonzero(apart) + 1])
    stops = np.concatenate([starts[1:], [len(time)]]) - 1
    distance = np.hypot(column["x"][order], column["y"][order])
    spans = []
    for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
        row = chosen.slice(int(order[start]), 1).to_pylist()[0]
        spans.append(
            _Span(
                int(tracks[start]),
                row["class"],
                row["asset"],
                int(row["phase"]),
                float(time[start]),
                float(time[stop]),
                float(distance[start : stop + 1].mean()),
            )
        )
    return spans


def _nobody(ride: RideSpec, motion: Motion, file: str | None) -> InputError:
    if ride.track is not None:
        tracks = motion.rows["track"].to_numpy()
        least, most = (int(tracks.min()), int(tracks.max())) if len(tracks) else (0, 0)
        return InputError(
            f"the motion has no track {ride.track}",
            file=file,
            place="ride.track",
            expected=f"one of its tracks, {least} to {most}" if most else "a motion with traffic",
        )
    classes = sorted(motion.rows.distinct(["class"])["class"].to_pylist())
    return InputError(
        f"the motion has no {ride.actor_class}",
        file=file,
        place="ride.class",
        expected=f"one of {', '.join(classes)}" if classes else "a motion with traffic",
    )


def _on_roof(mounted: MountedSensor, roof_m: float) -> MountedSensor:
    """Resolve a height above the carrier's roof."""
    pose = mounted.carrier_SE3_sensor
    if pose is None or mounted.above_roof_m is None:
        return mounted
    x, y, _ = pose.translation
    raised = Pose(pose.rotation, np.array([x, y, roof_m + mounted.above_roof_m]))
    return replace(mounted, site_SE3_sensor=raised, carrier_SE3_sensor=raised)
