"""Calibration of a site's demand to an observation of seconds or minutes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin import __version__
from urbantwin.artefact import passing_folder, replaced_folder, sha256_of
from urbantwin.progress import Progress, between, untold
from urbantwin.site import load_site
from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.calibration.momentary_drivers import momentary_drivers
from urbantwin.traffic.calibration.passages import MOTORS, SeenTrack
from urbantwin.traffic.calibration.presence import (
    Presence,
    arms_of,
    corrected,
    corrected_arms,
    first_flows,
    flows_of_arms,
    misfit,
    passed_per_hour,
    passes_an_arm,
    presence_of,
    sampled,
)
from urbantwin.traffic.calibration.simulated import simulated_tracks
from urbantwin.traffic.calibration.site_document import built, document_of, write_calibrated
from urbantwin.traffic.observed import FrameTimes, ObservedTracks, read_observation

__all__ = ["calibrate_observation"]

#: Number and duration, seconds, of the simulations that correct the flows; the one most like the
#: recording is used.
_ROUNDS, _TRIAL_S = 8, 300.0
#: Flows are given by arm if at least this share of the simulated motor traffic passes an arm, since
#: otherwise the rest would be lost; and if at least this many vehicles are on the arms in the
#: recording, since fewer would leave the distribution to chance.
_MIN_ARM_SHARE, _MIN_PRESENT_ON_ARMS = 0.9, 5.0
#: Maximum distance from a sensor at which nearly all actors are seen, metres.
_VISIBLE_RADIUS_M = 40.0
#: Classes of a demand; those not observed get none.
_DEMAND_CLASSES = [name for name in ACTOR_CLASSES if name not in ("animal", "trailer", "tram")]
#: Margin along the border of the observed area that is only partly seen, metres.
_EDGE_M = 2.0


def calibrate_observation(
    observed: Path, site: Path, out: Path, *, seed: int = 1, progress: Progress = untold
) -> dict[str, Any]:
    """Write the demand for which as many actors are present as were observed.

    Args:
        observed: folder written by ``urbantwin traffic observe --twin``.
        site: the ``site.yaml``.
        out: the folder to write: ``traffic.yaml`` for ``urbantwin drive --demand``, ``site.yaml``
            with this traffic, ``calibration.json``.
        seed: random seed of the simulations.
        progress: called with the fraction done and what is being done.

    Returns:
        The content of ``calibration.json``. ``standard_error`` is the spread among spans of the
            last simulation that are as long as the recording, because of chance and of the phase of
            the signals.

    Raises:
        InputError: the observation or the site cannot be used.
        StageError: netconvert or SUMO failed.
    """
    loaded = load_site(site)
    tracks, times = read_observation(observed)
    moments_s = times.time_s
    inputs = [observed, *loaded.files()]
    with (
        replaced_folder(out, kind="calibration", inputs=inputs) as folder,
        passing_folder("urbantwin-calibrate") as scratch,
    ):
        document = document_of(site)
        twin = built(document, scratch, between(progress, 0.0, 0.2))
        area = seen_well(tracks)
        arms = arms_of(twin.roads, area)
        recorded = presence_of(tracks, moments_s, area, arms)
        trial_s = np.arange(0.0, _TRIAL_S, 1.0)

        def simulated(
            per_hour: dict[str, float], of_arms: dict[str, float], turn: int
        ) -> list[SeenTrack]:
            settings = {**twin.site["traffic"], "counts": _counts(of_arms), "seed": seed}
            settings["per_hour"] = {name: per_hour.get(name, 0.0) for name in ACTOR_CLASSES}
            begun = 0.2 + 0.8 * turn / _ROUNDS
            tell = between(progress, begun, begun + 0.8 / _ROUNDS)
            what = f"simulating who is present, {turn + 1} of {_ROUNDS}"
            return simulated_tracks(
                twin,
                settings,
                _TRIAL_S,
                area,
                scratch=scratch,
                told=lambda share: tell(share, what),
            )

        on_arms = sum(float(presence.mean()) for presence in recorded.arms.values())
        flows, of_arms, best = first_flows(recorded), dict[str, float](), None
        for turn in range(_ROUNDS):
            trial = simulated(flows, of_arms, turn)
            moments = sampled(trial, trial_s)
            present = presence_of(moments, trial_s, area, arms)
            off = misfit(recorded, present)
            # The first round decides whether counts by arm are used, and is the result if they are
            # not.
            if best is None or (of_arms and not best.arms) or off < best.off:
                passed = passed_per_hour(trial, area, _TRIAL_S)
                best = _Trial(flows, of_arms, present, passed, off, moments)
            left = {name: passed_per_hour(trial, arm, _TRIAL_S) for name, arm in arms.items()}
            if of_arms:
                of_arms = _rounded(corrected_arms(of_arms, recorded, present, left))
            elif (
                turn == 0
                and on_arms > _MIN_PRESENT_ON_ARMS
                and passes_an_arm(trial, arms) > _MIN_ARM_SHARE
            ):
                of_arms = {name: flow for name, flow in left.items() if flow > 0}
                of_arms = _rounded(corrected_arms(of_arms, recorded, present, left))
            limit = np.inf if of_arms else passed_per_hour(trial, area, _TRIAL_S)
            flows = _rounded(corrected(flows, recorded, present, limit))
            if of_arms:  # classes share the flows of the arms
                more = sum(of_arms.values()) / sum(q for name, q in flows.items() if name in MOTORS)
                flows = _rounded({k: q * (more if k in MOTORS else 1) for k, q in flows.items()})
        assert best is not None
        flows, of_arms, last, passed = best.flows, best.arms, best.present, best.passed
        spans_s = _spans_s(times)
        manner, manner_rows = momentary_drivers(
            tracks, best.moments, len(moments_s), area, twin.site["traffic"]
        )
        report = {
            "kind": "calibration",
            "urbantwin": __version__,
            "tracks": [
                {"name": name, "sha256": sha256_of(observed / name)}
                for name in ("observation.json", "tracks.csv")
            ],
            "recorded_s": round(sum(spans_s), 3),
            "looks": len(spans_s),
            "simulated_s": _TRIAL_S,
            "seen_m2": round(float(area.area), 1),
            "motor_vehicles_passed_per_hour": round(passed, 1),
            "demand": _flow_rows(flows, of_arms, recorded, last, spans_s),
            "manner": manner_rows,
        }
        traffic: dict[str, Any] = {
            "per_hour": {name: flows.get(name, 0.0) for name in _DEMAND_CLASSES}
        }
        if of_arms:
            traffic["counts"] = _counts(of_arms)
        traffic |= manner
        write_calibrated(folder, document, traffic, report, files=(site.parent, out))
    progress(1.0, "done")
    return report


def seen_well(tracks: ObservedTracks) -> shapely.Geometry:
    """Return the area in which nearly all actors were seen."""
    area = shapely.MultiPoint(tracks.xy).convex_hull.buffer(-_EDGE_M)
    if len(tracks.sensors):
        area &= shapely.MultiPoint(tracks.sensors).buffer(_VISIBLE_RADIUS_M)
    return area


def _spans_s(times: FrameTimes) -> list[float]:
    """Return the duration of each span without a gap, seconds: as many steps as frames."""
    group, time_s = times.group(), times.time_s
    steps_s = np.diff(time_s)[~times.gap]
    step = float(np.median(steps_s)) if len(steps_s) else 1.0
    return [float(np.ptp(time_s[group == k])) + step for k in range(int(group[-1]) + 1)]


@dataclass(frozen=True)
class _Trial:
    """Flows of a simulation, and its presence and deviation from the observation.

    Attributes:
        flows: by class, per hour.
        arms: motor vehicles by arm, per hour; empty: by any arm.
        present: presence in the simulation.
        passed: motor vehicles per hour that passed in it.
        off: its deviation.
        moments: sampled tracks of it.
    """

    flows: dict[str, float]
    arms: dict[str, float]
    present: Presence
    passed: float
    off: float
    moments: ObservedTracks


def _rounded(flows: dict[str, float]) -> dict[str, float]:
    return {name: round(value, 1) for name, value in flows.items()}


def _counts(of_arms: dict[str, float]) -> list[dict[str, Any]]:
    return [{"road": name, "per_hour": value} for name, value in sorted(of_arms.items())]


def _flow_rows(
    flows: dict[str, float],
    of_arms: dict[str, float],
    recorded: Presence,
    last: Presence,
    spans_s: list[float],
) -> list[dict[str, Any]]:
    """Return an entry for each class and arm: flow, standard error, and presence in both."""
    # Spans separated by gaps are treated as independent.
    looks = len(spans_s)
    spread = last.spread(max(1, round(sum(spans_s) / looks)))
    rows: list[dict[str, Any]] = []
    for of, flows_of, present, present_simulated, kind in (
        ("class", flows, recorded.classes, last.classes, "classes"),
        ("road", of_arms or flows_of_arms(flows, recorded), recorded.arms, last.arms, "arms"),
    ):
        for name, q in sorted(flows_of.items()):
            share = spread[kind].get(name)
            rows.append(
                {
                    of: name,
                    "per_hour": round(q, 1),
                    "standard_error": None if share is None else round(q * share / looks**0.5, 1),
                    "present": _mean(present.get(name)),
                    "present_simulated": _mean(present_simulated.get(name)),
                }
            )
    return rows


def _mean(present: NDArray[np.float64] | None) -> float:
    return 0.0 if present is None else round(float(present.mean()), 2)
