"""Calibration of a site's traffic to a recording, and its evaluation on a held-out part."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin import __version__
from urbantwin.artefact import passing_folder, replaced_folder, sha256_of
from urbantwin.errors import InputError
from urbantwin.progress import Progress, between, untold
from urbantwin.site import load_site
from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.calibration.actuated import ActuatedCycle
from urbantwin.traffic.calibration.arrivals import arrivals_of, come_evenly, platoons_of
from urbantwin.traffic.calibration.bicycles import bicycle_counts
from urbantwin.traffic.calibration.drivers import ROUNDS, fitted_drivers, of_approaches, of_classes
from urbantwin.traffic.calibration.elsewhere import counted_elsewhere
from urbantwin.traffic.calibration.judged import judged, told_of
from urbantwin.traffic.calibration.lane_place import lane_offset
from urbantwin.traffic.calibration.lane_use import LaneUse, approach_rows
from urbantwin.traffic.calibration.measured import Measured
from urbantwin.traffic.calibration.on_twin import measuring, passed
from urbantwin.traffic.calibration.parameters import traffic_of
from urbantwin.traffic.calibration.passages import (
    JunctionLinks,
    Passage,
    SeenTrack,
)
from urbantwin.traffic.calibration.signal_timing import Timing, timing_of
from urbantwin.traffic.calibration.simulated import seen_area, simulated_tracks
from urbantwin.traffic.calibration.site_document import built, document_of, write_calibrated
from urbantwin.traffic.calibration.uncounted import UncountedFlows, ways_missed
from urbantwin.traffic.calibration.ways_seen import ways_seen
from urbantwin.traffic.recorded.read import files_of, read_recording
from urbantwin.traffic.recorded.rejoined import rejoined
from urbantwin.traffic.recorded.track import RecordedSignals, RecordedTrack
from urbantwin.traffic.recorded.track_smoothing import smooth_track
from urbantwin.twin import Twin

__all__ = ["calibrate_traffic"]

_STEP_S = 0.1
#: Duration of the simulations in which drivers are fitted, seconds; up to twice as long, if the
#: fitted part is.
_TRIAL_S = 600.0


def calibrate_traffic(
    tracks: Path,
    site: Path,
    out: Path,
    *,
    fit_share: float = 0.6,
    gap_s: float = 5.0,
    seconds: float = 3600.0,
    seed: int = 1,
    progress: Progress = untold,
) -> dict[str, Any]:
    """Write the traffic of a site derived from a recording, and its agreement with a simulation.

    The recording is split in time: the first part is fitted to; the part after a gap is for
    evaluation.

    Args:
        tracks: a description of tracks (YAML), or a file of tracks.
        site: the ``site.yaml``.
        out: the folder to write: ``traffic.yaml`` for ``urbantwin drive --demand``, ``site.yaml``
            with traffic and signals, ``calibration.json``.
        fit_share: share of the recording that is fitted to; 1: all, without evaluation.
        gap_s: gap between the two parts, seconds.
        seconds: duration of the simulation that is evaluated; 0 for none.
        seed: random seed of the simulations.
        progress: called with the fraction done and what is being done.

    Returns:
        The content of ``calibration.json``.

    Raises:
        InputError: the tracks or the site cannot be used.
        StageError: netconvert or SUMO failed.
    """
    if not 0.1 <= fit_share <= 1.0:
        raise InputError(f"a share of {fit_share:g}", place="fit_share", expected="0.1 to 1")
    loaded = load_site(site)
    inputs = [*files_of(tracks), *loaded.files()]
    with (
        replaced_folder(out, kind="calibration", inputs=inputs) as folder,
        passing_folder("urbantwin-calibrate") as scratch,
    ):
        progress(0.0, "reading tracks")
        recording = read_recording(tracks, loaded.frame)
        whole, mended = rejoined(recording.tracks)
        seen = _smoothed(whole)
        end_s = recording.duration_s
        fit_s = end_s * fit_share
        document = document_of(site)
        middle = loaded.frame.lonlat_from_site(_middle(seen)[None])[0]
        if recording.signals is not None and loaded.roads is not None:
            _with_signals(document, middle)
        twin, links_and_passages, timing = _timed_twin(
            document, seen, (recording.signals, middle, fit_s), scratch, progress
        )
        links, passages = links_and_passages
        recorded = measuring(twin, seen, links, passages)
        part = recorded(0.0, fit_s)
        if not part.turns:
            raise InputError(
                f"no vehicle passes the junction in its first {fit_s:.0f} s",
                file=recording.file,
                expected="motor vehicles that are seen on an approach and an exit, or between them",
            )
        # The places of counts, too, must not depend on the held-out part.
        early = [track for track in seen if track.time_s[0] < fit_s]
        passed_early = [passage for passage in passages if passage.seen.time_s[0] < fit_s]
        elsewhere = counted_elsewhere(early, twin.roads, links.junction)
        counted_beyond = ways_seen(passed_early, twin.roads, elsewhere.times)
        counted = replace(elsewhere, times={**elsewhere.times, **counted_beyond})
        traffic, missing = traffic_of(part, passed_early, _sizes(seen, fit_s), 0.0, counted)
        traffic["counts"] += bicycle_counts(part, early, twin.roads, links)
        missing += ways_missed(part, links, elsewhere.besides(passed_early, fit_s))
        own_cycle_s = 0.0 if timing is None else timing.cycle_s
        riding = lane_offset(seen, twin.roads, fit_s)
        traffic |= {
            **_arrivals(part, passages, twin, own_cycle_s),
            "drivers": {} if riding[0] is None else {"bicycle": {"lane_offset_m": riding[0]}},
            "approaches": [],
        }
        settings = {**twin.site["traffic"], **traffic, "seed": seed}
        settings["per_hour"] = {name: traffic["per_hour"].get(name, 0.0) for name in ACTOR_CLASSES}
        driver_rows: list[dict[str, Any]] = []
        lanes = LaneUse(part, links)
        if seconds > 0:
            uncounted = UncountedFlows(part, {row["actor_class"] for row in traffic["counts"]})
            drivers, driver_rows, untold = _fitted(
                twin, settings, part, (uncounted, lanes), seen, scratch, between(progress, 0.4, 0.7)
            )
            traffic["approaches"] = settings["approaches"] = approach_rows(
                lanes, of_approaches(drivers)
            )
            traffic["drivers"] = settings["drivers"] = _drivers_of_traffic(traffic, drivers, part)
            traffic["per_hour"] |= uncounted.per_hour
            missing += untold + uncounted.untold()
        report: dict[str, Any] = {
            "kind": "calibration",
            "urbantwin": __version__,
            "tracks": [{"name": x.name, "sha256": sha256_of(x)} for x in files_of(tracks)],
            "recorded_s": round(end_s, 3),
            "tracks_rejoined": mended,
            "fitted_s": [0.0, round(fit_s, 3)],
            "measured": told_of(part),
            "signals": _signals_report(timing),
            "platoons": traffic["arrivals"],
            "counted_set_out": traffic["counted_set_out"],
            "lanes": lanes.told(),
            "not_told": missing,
            "lane_offset_of_bicycles": {"metres": riding[0], "count": riding[1]},
            "drivers": driver_rows,
        }
        if seconds > 0:
            report["simulated_s"] = seconds
            report |= judged(
                twin,
                settings,
                (part, recorded, seen),
                (fit_s + gap_s, end_s),
                seconds,
                scratch,
                between(progress, 0.7, 1.0),
                own_cycle_s,
            )
        write_calibrated(folder, document, traffic, report, files=(site.parent, out))
    progress(1.0, "done")
    return report


def _timed_twin(
    document: dict[str, Any],
    seen: list[SeenTrack],
    lit: tuple[RecordedSignals | None, np.ndarray[Any, Any], float],
    scratch: Path,
    progress: Progress,
) -> tuple[Twin, tuple[JunctionLinks, list[Passage]], Timing | None]:
    """Return the twin, the passages over its main junction, and the signal timing if recorded.

    The timing is then added to the document. ``lit``: recorded signals, their place, and the end of
    the part that is fitted to.
    """
    signals, middle, fit_s = lit
    twin = built(document, scratch, between(progress, 0.05, 0.25))
    links_and_passages = passed(twin, seen)
    timing = (
        None
        if signals is None
        else timing_of(signals, links_and_passages[1], links_and_passages[0], fit_s)
    )
    if timing is not None:
        _with_signals(document, middle)
        _with_timing(document, timing)
        twin = built(document, scratch, between(progress, 0.25, 0.4))
        links_and_passages = passed(twin, seen)
    return twin, links_and_passages, timing


def _arrivals(
    part: Measured, passages: Sequence[Passage], twin: Twin, cycle_s: float
) -> dict[str, Any]:
    """Return the platoons of arrivals in the part that is fitted to, and whether they are even."""
    factor = float(np.median(part.all_free)) if part.free else 1.0
    arrivals = arrivals_of(passages, twin.roads, factor, 0.0, part.seconds)
    platoons = platoons_of(arrivals, part.seconds, cycle_s)
    cycle_s = max([cycle_s, *(platoon["cycle_s"] for platoon in platoons)])
    evenly = come_evenly(arrivals, part.seconds, cycle_s)
    return {"arrivals": platoons, "counted_set_out": "evenly" if evenly else "at_random"}


def _sizes(seen: Sequence[SeenTrack], until_s: float) -> dict[str, np.ndarray[Any, Any]]:
    """Return class -> (N, 3) sizes of tracks that begin before a time, metres."""
    sizes: dict[str, list[np.ndarray[Any, Any]]] = defaultdict(list)
    for track in seen:
        if track.time_s[0] < until_s:
            sizes[track.track.actor_class].append(track.track.size)
    return {name: np.array(of_class) for name, of_class in sizes.items()}


def _smoothed(tracks: Sequence[RecordedTrack]) -> list[SeenTrack]:
    smoothed = []
    for track in tracks:
        track_states = smooth_track(track, _STEP_S)
        if track_states is not None:
            smoothed.append(
                SeenTrack(
                    track,
                    track_states.time_s,
                    track_states.xy,
                    track_states.yaw,
                    track_states.speed,
                )
            )
    return smoothed


def _middle(seen: list[SeenTrack]) -> np.ndarray[Any, Any]:
    """Return the median position of all tracks."""
    return np.asarray(np.median(np.concatenate([track.xy[::10] for track in seen]), axis=0))


def _with_signals(document: dict[str, Any], lonlat: np.ndarray[Any, Any]) -> None:
    """Give the junction signals, unless a program of the site names one."""
    if not document.get("signals"):
        place = {"latitude": round(float(lonlat[1]), 7), "longitude": round(float(lonlat[0]), 7)}
        document["signals"] = [{"junction": place, "offset": 0.0}]


def _with_timing(document: dict[str, Any], timing: Timing) -> None:
    """Set the junction's program to the recorded timing."""
    first = dict(document["signals"][0])
    first.pop("phases", None)
    first.pop("cycle", None)
    first["minimum_green"] = 0.0
    first["states"] = timing.program
    document["signals"] = [first, *document["signals"][1:]]


def _fitted(
    twin: Twin,
    asked: dict[str, Any],
    part: Measured,
    learned: tuple[UncountedFlows, LaneUse],
    seen: list[SeenTrack],
    scratch: Path,
    progress: Progress,
) -> tuple[dict[str, float], list[dict[str, Any]], list[str]]:
    """Return drivers whose simulations agree with the recording (``fitted_drivers``).

    The simulations also correct flows and lane use; the flows in ``asked`` are updated.
    """
    uncounted, lanes = learned
    area = seen_area(seen)
    trial_s = float(np.clip(part.seconds, _TRIAL_S, 2 * _TRIAL_S))

    def simulated(drivers: Mapping[str, float], turn: int) -> Measured:
        tell = between(progress, turn / ROUNDS, (turn + 1) / ROUNDS)
        tracks = simulated_tracks(
            twin,
            {
                **asked,
                "drivers": _drivers_of_traffic(asked, drivers, part),
                "approaches": approach_rows(lanes, of_approaches(drivers)),
            },
            trial_s,
            area,
            scratch=scratch,
            told=partial(_report_trial_progress, tell, f"simulating what is compared, {turn + 1}"),
        )
        trial = measuring(twin, tracks, *passed(twin, tracks))(0.0, trial_s)
        uncounted.learn(asked["per_hour"], trial)
        lanes.learn(trial)
        asked["per_hour"] = {**asked["per_hour"], **uncounted.per_hour}
        return trial

    fitted = fitted_drivers(part, simulated)
    if not fitted[1] and (uncounted.per_hour or lanes.recorded):  # no driver parameters to fit
        simulated({}, 0)
    return fitted


def _drivers_of_traffic(
    traffic: Mapping[str, Any], drivers: Mapping[str, float], part: Measured
) -> dict[str, Any]:
    """Return drivers of motor traffic in addition to those of a demand."""
    return {**traffic["drivers"], **of_classes(drivers, part.classes)}


def _report_trial_progress(tell: Progress, what: str, share: float) -> None:
    tell(share, what)


def _signals_report(timing: Timing | None) -> dict[str, Any] | None:
    if timing is None:
        return None
    return {
        "cycle_s": timing.cycle_s,
        "cycles_seen": timing.cycles,
        "green_s": timing.greens,
        "group_of_link": {str(link): group for link, group in sorted(timing.group_of.items())},
        "links_told_by_passages": list(timing.certain),
        "actuated": None if timing.actuated is None else _actuated_report(timing.actuated),
    }


def _actuated_report(cycle: ActuatedCycle) -> dict[str, Any]:
    """Return the ranges of durations of actuated phases, and whether the program uses them."""
    return {
        "driven": cycle.driven,
        "cycles": cycle.cycles,
        "share_in_this_order": round(cycle.ordered, 3),
        "phases": [
            {
                "green": [
                    name for name, letter in zip(cycle.groups, shown, strict=True) if letter in "Gg"
                ],
                "seconds": seconds,
                "at_least": least,
                "at_most": most,
            }
            for shown, seconds, least, most in zip(
                cycle.letters, cycle.seconds, cycle.at_least, cycle.at_most, strict=True
            )
            if least < most
        ],
    }
