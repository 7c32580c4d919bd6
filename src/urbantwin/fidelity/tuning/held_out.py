"""Evaluation of a fit on the held-out frames."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.artefact import write_json
from urbantwin.errors import InputError
from urbantwin.fidelity.definitions import MEASURES
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.measure import Figures, RealFrame
from urbantwin.fidelity.readers import Recording
from urbantwin.fidelity.sampling import evenly
from urbantwin.fidelity.tuning.actor_terms import ActorTerms, actor_changes
from urbantwin.fidelity.tuning.fit import RigFit, RigTerms, views_of
from urbantwin.fidelity.tuning.fit_actors import real_clusters
from urbantwin.fidelity.tuning.frames import Looks, Split, looks_of
from urbantwin.fidelity.tuning.knobs import Values, starts
from urbantwin.fidelity.tuning.page import write_report
from urbantwin.fidelity.tuning.study import Term
from urbantwin.fidelity.tuning.tuned_rig import PointsIn, SimulatedFrames, tuned_rig
from urbantwin.lidar import Rig
from urbantwin.traffic import Motion
from urbantwin.traffic.resize import resized
from urbantwin.twin import Twin

__all__ = ["judge"]

#: Number of held-out frames, spread evenly, that are measured as in `compare`.
_MEASURED = 4
#: Measures that are reported as worse, if they are larger by more than this share.
_HEADLINES = ("hausdorff_p95_m", "js_mean", "js_intensity", "point_to_mesh_mean_m", "chamfer_m")
_LARGER = 0.02
#: Difference of losses, in standard errors, below which they are equal.
_CLEAR = 1.0


def judge(  # noqa: PLR0913 - all parts of a fit
    recording: Recording,
    split: Split,
    twin: Twin,
    rig: Rig,
    fit: RigFit,
    points_in: PointsIn,
    out: Path,
    *,
    motion: Motion | None,
    scale: float | None,
    seed: int,
    training: Looks | None,
    tell: Callable[[float, str], None],
) -> dict[str, Any]:
    """Evaluate a fit on the held-out frames, and write ``held_out.json`` and ``report.html``.

    Args:
        recording: the real frames.
        split: parts of the recording.
        twin: twin of the recorded place.
        rig: the rig before the fit.
        fit: result of the fit.
        points_in: frame of the real points.
        out: the folder with ``rig.yaml`` and ``tuning.json``.
        motion: the traffic, if any.
        scale: full scale of intensity.
        seed: seed of all random numbers.
        training: the training frames, for the report; ``None``: no measures, no report.
        tell: called with the fraction done and the current step.

    Returns:
        The contents of ``held_out.json``; if no frame is readable, the reason.
    """
    try:
        held, _ = looks_of(recording, split.held_out, len(rig.sensors), scale=scale)
    except InputError as error:
        found: dict[str, Any] = {"frames": 0, "problems": [str(error)]}
        write_json(out / "held_out.json", found)
        return found
    tell(0.1, "the terms of the fit on frames held out")
    groups = _groups(RigTerms(held, twin, rig, points_in, seed), fit)
    worse = [f"{name}: worse than before on frames held out" for name in _worse(groups)]
    found = {
        "frames": held.frames,
        "groups": groups,
        "warnings": worse,
        "problems": list(held.problems),
    }
    if training is not None:
        tell(0.4, "recording with the rig before and after")
        sides = {
            name: SimulatedFrames(
                twin, tuned_rig(rig, values), points_in, _sized(motion, values), seed
            )
            for name, values in (("start", starts(fit.knobs)), ("tuned", fit.values))
        }
        shown = _Shown(sides, held, scale)
        found["measured_frames"] = shown.count
        found["measures"] = shown.measures(lambda share: tell(0.4 + 0.5 * share, "measuring"))
        worse += _measured_worse(found["measures"])
    write_json(out / "held_out.json", found)
    if training is not None:
        tell(0.9, "drawing the report")
        write_report(out, fit, found, training, held, sides, scale)
    return found


def _sized(motion: Motion | None, values: Values) -> Motion | None:
    """Return a motion with the fitted sizes of actors; their number requires a new simulation."""
    size: Any = actor_changes(values, {}).get("size", {})
    return None if motion is None else resized(motion, size)


def _groups(terms: RigTerms, fit: RigFit) -> dict[str, dict[str, Any]]:
    """Return the loss of every group on the held-out frames, before and after."""
    named: dict[str, Term] = {}
    for one in fit.groups:
        if one.name == "actors":
            seen = real_clusters(terms, fit)
            if seen is not None and fit.simulated is not None:
                named["actors"] = ActorTerms(seen, fit.simulated)
        elif one.name == "pose":
            named["pose"] = terms.pose()
        elif one.name == "tilt":
            named["tilt"] = terms.tilt()
    rest = [one.name for one in fit.groups if one.name in ("reflectivity", "dropout", "noise")]
    if rest:
        posed = tuned_rig(terms.rig, fit.values)
        returns = terms.returns(views_of(posed, terms.twin, terms.seed), fit.values)
        if returns.cells:
            named |= {name: getattr(returns, name) for name in rest}
    found = {}
    for one in fit.groups:
        if one.name not in named:
            continue
        before = {k.name: k.start for k in fit.knobs if k.name in one.values}
        at_start = named[one.name]({**fit.values, **before})
        tuned = named[one.name](fit.values)
        worse, error = tuned.worse_than(at_start)
        found[one.name] = {
            "start": round(at_start.mean, 5),
            "tuned": round(tuned.mean, 5),
            "verdict": "same"
            if abs(worse) <= _CLEAR * error
            else "worse"
            if worse > 0
            else "better",
        }
    return found


def _worse(groups: dict[str, dict[str, Any]]) -> list[str]:
    return [name for name, one in groups.items() if one["verdict"] == "worse"]


def _measured_worse(measures: dict[str, dict[str, float | None]]) -> list[str]:
    """Return messages on measures that became larger, even if the loss of groups decreased."""
    said = []
    for name in _HEADLINES:
        row = measures.get(name, {})
        before, after = row.get("start"), row.get("tuned")
        if before is not None and after is not None and after > (1 + _LARGER) * before:
            title = MEASURES[name].title
            said.append(
                f"{title}: worse than before on frames held out, {before:.3g} to {after:.3g}"
            )
    return said


class _Shown:
    """Held-out frames with simulated frames before and after, and with their neighbours."""

    def __init__(self, sides: dict[str, SimulatedFrames], held: Looks, scale: float | None) -> None:
        self._sides, self._clouds, self._scale = sides, held.clouds, scale
        self._numbers = evenly(len(held.clouds), _MEASURED)
        self.count = len(self._numbers)

    def measures(self, tell: Callable[[float], None]) -> dict[str, dict[str, float | None]]:
        """Return the mean of every measure of ``compare``: start, tuned, real against real."""
        rows: dict[str, list[Figures]] = {"start": [], "tuned": [], "real": []}
        for done, number in enumerate(self._numbers):
            tell(done / self.count)
            real = self._clouds[number]
            first = self._sides["start"].frame(int(number))
            origin = first.sensor_places[0]
            frame = RealFrame(real, intensity_scale=self._scale, origin=origin)
            others: dict[str, Frame | None] = {
                name: side.frame(int(number)) for name, side in self._sides.items()
            }
            others["real"] = self._clouds[number + 1] if number + 1 < len(self._clouds) else None
            for name, other in others.items():
                if other is not None:
                    own = self._scale if name == "real" else 1.0
                    scale = None if self._scale is None else own
                    rows[name].append(frame.measure(other, intensity_scale=scale).figures)
        names = list(dict.fromkeys(key for one in rows["start"] for key in one))
        return {
            key: {side: _mean([row.get(key) for row in found]) for side, found in rows.items()}
            for key in names
        }


def _mean(values: list[float | None]) -> float | None:
    known = [one for one in values if one is not None]
    return round(float(np.mean(known)), 6) if known else None
