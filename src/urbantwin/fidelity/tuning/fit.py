"""Fit of a rig in groups of parameters, each with the values that the earlier groups gave."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from urbantwin.fidelity.tuning.actor_terms import Clusters
from urbantwin.fidelity.tuning.frames import Looks
from urbantwin.fidelity.tuning.group_fit import AT_BOUND, FITTED, GroupFit, Searching, fit_group
from urbantwin.fidelity.tuning.knobs import TILT_DEG, Knob, rig_knobs, starts
from urbantwin.fidelity.tuning.pose_term import COARSE_M, FINE_M, PoseTerm, TiltTerm
from urbantwin.fidelity.tuning.prediction import BeamView, beam_view
from urbantwin.fidelity.tuning.return_terms import ReturnTerms
from urbantwin.fidelity.tuning.study import Term
from urbantwin.fidelity.tuning.tuned_rig import PointsIn, tuned_rig
from urbantwin.lidar import Rig
from urbantwin.twin import Twin

__all__ = ["RigFit", "RigTerms", "fit_rig", "views_of"]

#: Loss of a pose above which most points are not near the twin.
_STRANGE = 0.5
_TILT = ("move.pitch_deg", "move.roll_deg")
#: Groups whose terms require a spinning sensor.
_OF_RETURNS = ("reflectivity", "dropout", "noise")


@dataclass(eq=False)
class RigFit:
    """Result of the fit of a rig.

    Attributes:
        knobs: all parameters that were searched.
        values: their values.
        groups: results of the groups, in the order of fitting.
        notes: notes for the report, one sentence each.
        simulated: moving clusters in frames of the twin, if actors were fitted.
    """

    knobs: list[Knob] = field(default_factory=list)
    values: dict[str, float] = field(default_factory=dict)
    groups: list[GroupFit] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    simulated: Clusters | None = None


@dataclass(eq=False)
class RigTerms:
    """Loss terms of a rig on the frames of one part.

    Args:
        looks: the frames.
        twin: twin of the recorded place.
        rig: the rig as written.
        points_in: frame of the real points.
        seed: seed of the sampled points.
    """

    looks: Looks
    twin: Twin
    rig: Rig
    points_in: PointsIn
    seed: int

    def pose(self, half_m: tuple[float, ...] = FINE_M) -> Term:
        """Return the term of position and heading, and of the tilt of points that are not level."""
        return PoseTerm(self.looks, self.rig, self.twin.mesh, self.points_in, self.seed, half_m)

    def tilt(self) -> TiltTerm:
        """Return the term of the tilt of levelled points."""
        return TiltTerm(self.looks, self.rig, self.seed)

    def returns(self, views: Sequence[BeamView], values: dict[str, float]) -> ReturnTerms:
        """Return the terms of dropout, noise and reflectivity at a pose."""
        return ReturnTerms(self.looks, tuned_rig(self.rig, values), views, self.points_in)


def fit_rig(
    training: RigTerms,
    validation: RigTerms | None,
    groups: Sequence[str],
    searching: Searching,
    tell: Callable[[str], None],
) -> RigFit:
    """Fit a rig to the frames of two parts.

    The pose is fitted first: the surfaces that beams hit depend on nothing else. Then follow
    intensities, which show reflectivities; dropout, which depends on these; and noise, which grows
    as returns get weak.

    Args:
        training: terms of the frames that are fitted.
        validation: terms of the frames that decide whether a group's fit is kept; ``None``: too few
            frames.
        groups: groups to fit.
        searching: options of the search.
        tell: called with the current step.
    """
    rig = training.rig
    fit = RigFit()

    def run(name: str, knobs: list[Knob], terms: tuple[Term, Term | None], **first: float) -> None:
        begin = starts(knobs)
        fit.knobs += knobs
        fit.values |= begin
        found = fit_group(
            name,
            knobs,
            *terms,
            values=dict(fit.values),
            begin=begin | first,
            searching=searching,
            spread=0.02 if first else 0.12,
        )
        fit.values |= found.values
        fit.groups.append(found)

    if "pose" in groups:
        _fit_pose(training, validation, searching, run, fit, tell)
    spins = all(one.sensor.pattern is None for one in rig.sensors)
    wanted = [one for one in groups if one in _OF_RETURNS]
    if wanted and not spins:
        fit.notes.append(
            f"Not fitted: {', '.join(wanted)}. A sensor draws a pattern that does not repeat, so "
            "its beams cannot be distinguished."
        )
    elif wanted:
        tell("casting the beams")
        posed = tuned_rig(rig, fit.values)
        views = views_of(posed, training.twin, training.seed)
        mine = training.returns(views, fit.values)
        proof = None if validation is None else validation.returns(views, fit.values)
        _fit_returns(rig, wanted, mine, proof, run, fit, training.looks.intensity is not None)
    return fit


def views_of(posed: Rig, twin: Twin, seed: int) -> list[BeamView]:
    """Return the surfaces that the beams of every sensor hit."""
    return [
        beam_view(posed, number, twin.mesh, twin.surface_materials, seed)
        for number in range(len(posed.sensors))
    ]


def _fit_pose(
    training: RigTerms,
    validation: RigTerms | None,
    searching: Searching,
    run: Callable[..., None],
    fit: RigFit,
    tell: Callable[[str], None],
) -> None:
    if training.points_in == "site":
        fit.notes.append(
            "Pose is not fitted: real points in the frame of the site say where the sensor is."
        )
        return
    knobs = rig_knobs(training.rig, "pose")
    tell("preparing the pose")
    if training.points_in == "level":
        if all(one.sensor.pattern is None for one in training.rig.sensors):
            term = training.tilt()
            first = term.first_try(TILT_DEG)
            levelled = None if validation is None else validation.tilt()
            run("tilt", [one for one in knobs if one.name in _TILT], (term, levelled), **first)
        else:
            fit.notes.append(
                "Pitch and roll are not fitted: levelled points show them in rings only."
            )
        knobs = [one for one in knobs if one.name not in _TILT]
    # first with a wide minimum, then with a sharp one
    rough, _ = searching.search(
        "pose, roughly", knobs, training.pose(COARSE_M), fit.values, starts(knobs)
    )
    proof = None if validation is None else validation.pose()
    run("pose", knobs, (training.pose(), proof), **rough)
    if fit.groups[-1].losses["training"][1] > _STRANGE:
        fit.notes.append(
            "Most real points lie on no surface of the twin, wherever the rig is put: is it this "
            "place, roughly this pose (`align`), and the right frame of the points (--points-in)?"
        )
    if AT_BOUND in fit.groups[-1].state.values():
        fit.notes.append("The pose ended at a bound: find it by `align` first.")


def _fit_returns(
    rig: Rig,
    groups: Sequence[str],
    training: ReturnTerms,
    validation: ReturnTerms | None,
    run: Callable[..., None],
    fit: RigFit,
    has_intensity: bool,
) -> None:
    if not training.cells:
        fit.notes.append(
            f"Not fitted: {', '.join(groups)}. Nowhere do enough real points lie on a smooth "
            "surface of the twin: is the pose right?"
        )
        return
    for group in groups:
        knobs = rig_knobs(rig, group, training.materials, has_intensity=has_intensity)
        if not knobs:
            fit.notes.append("Reflectivity is not fitted: the real frames have no intensity.")
            continue
        proof = validation if validation is not None and validation.cells else None
        run(group, knobs, (getattr(training, group), proof and getattr(proof, group)))
        if group == "reflectivity":
            _fewest_factors(fit, knobs)


def _fewest_factors(fit: RigFit, knobs: Sequence[Knob]) -> None:
    """Divide intensities and reflectivities by a common factor, to leave the fewest factors.

    Only their products are observable. The sum of absolute logarithms is smallest if the common
    factor is their median.
    """
    found = fit.groups[-1]
    if any(found.state[one.name] != FITTED for one in knobs):
        return  # a parameter that kept its start fixes the common factor
    sign = {one.name: 1.0 if one.name.startswith("reflectivity.") else -1.0 for one in knobs}
    logs = sorted(sign[one.name] * np.log(found.values[one.name]) for one in knobs)
    common = logs[len(logs) // 2]
    divided = {
        one.name: float(np.exp(np.log(found.values[one.name]) - sign[one.name] * common))
        for one in knobs
    }
    if all(one.low <= divided[one.name] <= one.high for one in knobs):
        found.values.update(divided)
        fit.values |= divided
