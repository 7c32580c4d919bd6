"""Fit of the number and the sizes of actors, after the rig is fitted."""

from __future__ import annotations

from typing import Any

import numpy as np

from urbantwin.fidelity.sampling import evenly
from urbantwin.fidelity.tuning.actor_terms import (
    KINDS,
    ActorTerms,
    Clusters,
    actor_changes,
    actor_knobs,
    clusters_of,
)
from urbantwin.fidelity.tuning.fit import RigFit, RigTerms
from urbantwin.fidelity.tuning.group_fit import Searching, fit_group
from urbantwin.fidelity.tuning.knobs import starts
from urbantwin.fidelity.tuning.tuned_rig import SimulatedFrames, frame_of_points, tuned_rig
from urbantwin.traffic import Motion

__all__ = ["fit_actors", "real_clusters"]

#: Number of simulated frames in which actors are counted, spread over the motion.
_SIMULATED = 40


def fit_actors(
    training: RigTerms,
    validation: RigTerms | None,
    motion: Motion | None,
    fit: RigFit,
    searching: Searching,
) -> dict[str, Any] | None:
    """Fit density and size of actors, and add the result to ``fit``.

    Args:
        training: the frames that are fitted.
        validation: the frames that decide whether the fit is kept.
        motion: the twin's traffic; ``None``: nothing is fitted.
        fit: fit of the rig.
        searching: options of the search.

    Returns:
        The fields of ``traffic:`` that change; ``None`` if nothing was fitted.
    """
    if motion is None:
        fit.notes.append("Actors are kept: no motion was given to count the twin's own by.")
        return None
    real = real_clusters(training, fit)
    if real is None:
        fit.notes.append("Actors are kept: too few frames to detect what moves.")
        return None
    fit.simulated = _simulated(training, fit, motion)
    if fit.simulated is None:
        fit.notes.append("Actors are kept: the motion is too short to detect what moves.")
        return None
    terms = ActorTerms(real, fit.simulated)
    for kind in KINDS:
        if kind not in terms.kinds:
            counts = f"{real.of(kind).sum()} real and {fit.simulated.of(kind).sum()} simulated"
            fit.notes.append(f"Actors that are {kind} are kept: {counts} clusters are too few.")
    knobs = actor_knobs(terms)
    if not knobs:
        return None
    proof = None if validation is None else real_clusters(validation, fit)
    begin = starts(knobs)
    fit.knobs += knobs
    fit.values |= begin
    found = fit_group(
        "actors",
        knobs,
        terms,
        None if proof is None else ActorTerms(proof, fit.simulated),
        values=dict(fit.values),
        begin=begin,
        searching=searching,
        error=float(np.sqrt(2)),  # the simulated sample is as small as the real one
    )
    fit.values |= found.values
    fit.groups.append(found)
    return actor_changes(found.values, training.twin.site["traffic"]["per_hour"])


def real_clusters(terms: RigTerms, fit: RigFit) -> Clusters | None:
    """Return the moving clusters of real frames, at the fitted pose; ``None``: too few frames."""
    rig = tuned_rig(terms.rig, fit.values)
    place = frame_of_points(rig, terms.points_in)
    places = np.array([one.site_SE3_sensor.translation for one in rig.sensors])
    places = place.inverse().apply(places)
    return clusters_of(terms.looks.clouds, place, places, terms.twin.ground_mesh)


def _simulated(terms: RigTerms, fit: RigFit, motion: Motion) -> Clusters | None:
    rig = tuned_rig(terms.rig, fit.values)
    made = SimulatedFrames(terms.twin, rig, terms.points_in, motion, terms.seed)
    clouds = [made.frame(number) for number in evenly(made.count or 1, _SIMULATED)]
    place = frame_of_points(rig, terms.points_in)
    return clusters_of(clouds, place, clouds[0].sensor_places, terms.twin.ground_mesh)
