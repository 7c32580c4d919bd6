"""Registration of a model to the ground, the roads and the outlines of buildings.

Coarse to fine: upright; correlation with the map in plan over headings, shifts and, where asked
for, scales; the best few again in finer cells; walls to outlines; ground to ground. The best must
be clearly better than the second best, or the model is refused.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.ground import Elevation
from urbantwin.reconstruct.georeference.complaint import complaint
from urbantwin.reconstruct.georeference.correlation import Candidate, MapRaster
from urbantwin.reconstruct.georeference.ground_level import height_at_anchor, samples_of
from urbantwin.reconstruct.georeference.levelling import GroundFit, fit_ground, upright
from urbantwin.reconstruct.georeference.outline_fit import (
    Agreement,
    agreement,
)
from urbantwin.reconstruct.georeference.search import Freedom, Search, coarse_cell
from urbantwin.reconstruct.georeference.similarity import Similarity, moved
from urbantwin.reconstruct.model import ImportedModel
from urbantwin.reconstruct.surroundings import Surroundings
from urbantwin.site.geometry import GeometrySource

__all__ = ["Registration", "register"]

Progress = Callable[[float, str], None]

#: A second way that is nearly as good makes the first one a guess.
AMBIGUOUS = 0.85
#: Less agreement between walls and outlines than this is none.
_LEAST_SCORE = 0.15
_MOST_SHOWN = 8_000


@dataclass(frozen=True, eq=False)
class Registration:
    """How a model was moved, and what a picture shows of it.

    Attributes:
        transform: from the first place to the registered one, site frame.
        report: for ``geometry.json``: shift, turn, scale, residuals, confidence.
        before: (N, 2) walls (or rims of what stands high) at the first place.
        after: (N, 2) the same, registered.
        lines: what it says, a line each.
    """

    transform: Similarity
    report: dict[str, object]
    before: NDArray[np.float64]
    after: NDArray[np.float64]
    lines: tuple[str, ...]


def register(
    model: ImportedModel,
    source: GeometrySource,
    surroundings: Surroundings,
    elevation: Elevation | None,
    freedom: Freedom,
    progress: Progress | None = None,
) -> Registration:
    """Find where a model lies on the map.

    Args:
        model: at its first place: z-up, metres, roughly in the site frame.
        source: what ``site.yaml`` says of it.
        surroundings: the map in plan.
        elevation: the site's ground, ``None`` where it is not known.
        freedom: what may be changed.
        progress: told the share done (0..1) and what is being done.

    Raises:
        InputError: there is nothing to recognise, two ways are nearly as good, or the residual is
            above ``worst_residual_m``.
    """
    spec = source.spec.register_to
    assert spec is not None
    tell = progress or (lambda share, text: None)
    raster = MapRaster(surroundings, coarse_cell(surroundings.region))
    if not raster.tells:
        raise complaint(
            source,
            "cannot be registered: the map has no building and no road in the region",
            "register",
            expected="control_points, or origin",
        )
    levelled, level_notes = _levelled(model, freedom, elevation)
    search = Search(model, levelled, source, surroundings, freedom)
    levelled, features, ranked, best = search.run(raster, tell)
    pivot, outlines = search.pivot, search.outlines
    found = None
    if outlines is not None and search.has_walls(features):
        found = agreement(features, outlines, best, pivot, surroundings)
    in_plan = _similarity(best, pivot)
    tell(0.9, "laying it on the ground")
    in_plan_after_level = in_plan.after(levelled)
    ground = in_plan.apply(features.ground)
    fit, up = _laid(model, in_plan_after_level, ground, elevation, freedom)
    transform = up.after(in_plan_after_level)
    report = _report(transform.scale, best, ranked, pivot, found, fit, level_notes)
    _check(source, report, best, ranked, found, fit)
    step = max(1, len(features.walls) // _MOST_SHOWN)
    walls = np.column_stack([features.walls, np.zeros(len(features.walls))])[::step]
    after = in_plan.apply(walls)
    return Registration(transform, report, walls[:, :2], after[:, :2], _lines(report))


def _levelled(
    model: ImportedModel, freedom: Freedom, elevation: Elevation | None
) -> tuple[Similarity, dict[str, object]]:
    """Make a model level whose upward axis nobody said."""
    still = Similarity(1.0, np.eye(3), np.zeros(3))
    if not freedom.level:
        return still, {}
    turn, angle, over = upright(samples_of(model))
    # A street may well fall by a few degrees: without a DEM that is not taken away.
    if angle < (0.2 if elevation is not None else 6.0):
        return still, {}
    return turn, {"levelled_deg": round(angle, 2), "turned_over": over}


def _similarity(at: Candidate, pivot: NDArray[np.float64]) -> Similarity:
    turn = Similarity.in_plan(at.yaw, np.zeros(3), at.scale)
    shift = np.array([at.x, at.y, 0.0]) - turn.apply(np.array([[*pivot, 0.0]]))[0]
    return replace(turn, translation=shift)


def _laid(
    model: ImportedModel,
    transform: Similarity,
    ground: NDArray[np.float64],
    elevation: Elevation | None,
    freedom: Freedom,
) -> tuple[GroundFit | None, Similarity]:
    """Lay a model, registered in plan, on the ground: the site's, or z = 0 at the anchor."""
    if elevation is not None:
        fit = fit_ground(ground, elevation, tilt=freedom.place or freedom.heading or freedom.level)
        if fit is not None:
            return fit, fit.transform
    own = height_at_anchor(samples_of(moved(model, transform), ground=True))
    return None, Similarity(1.0, np.eye(3), np.array([0.0, 0.0, -(own or 0.0)]))


def _report(
    scale: float,
    best: Candidate,
    ranked: list[Candidate],
    pivot: NDArray[np.float64],
    found: Agreement | None,
    fit: GroundFit | None,
    notes: dict[str, object],
) -> dict[str, object]:
    second = ranked[1].score / max(1e-9, ranked[0].score) if len(ranked) > 1 else 0.0
    report: dict[str, object] = {
        **notes,
        "shift_m": [round(best.x - float(pivot[0]), 3), round(best.y - float(pivot[1]), 3)],
        "turn_deg": round(float(np.degrees(np.angle(np.exp(1j * best.yaw)))), 3),
        "scale": float(f"{scale:.6g}"),
        "score": round(ranked[0].score, 3),
        "second_best": round(max(0.0, second), 3),
        "confidence": round(1.0 - max(0.0, second), 3),
    }
    if found is not None:
        report["outlines"] = {
            "median_m": round(found.median_m, 3),
            "p95_m": round(found.p95_m, 3),
            "share_with_a_wall": round(found.walled, 3),
        }
    if fit is not None:
        report["ground"] = {
            "median_m": round(fit.median_m, 3),
            "p95_m": round(fit.p95_m, 3),
            "tilt_deg": round(fit.tilt_deg, 3),
            "raised_m": round(float(fit.transform.translation[2]), 3),
        }
    else:
        report["ground"] = "not known: laid on z = 0 at the anchor"
    return report


def _check(
    source: GeometrySource,
    report: dict[str, object],
    best: Candidate,
    ranked: list[Candidate],
    found: Agreement | None,
    fit: GroundFit | None,
) -> None:
    """Raise where the registration is no more than a guess."""
    spec = source.spec.register_to
    assert spec is not None
    if len(ranked) > 1 and ranked[1].score > AMBIGUOUS * ranked[0].score:
        turn = np.degrees(np.angle(np.exp(1j * (ranked[1].yaw - ranked[0].yaw))))
        away = np.hypot(ranked[1].x - ranked[0].x, ranked[1].y - ranked[0].y)
        raise complaint(
            source,
            f"fits the map in two ways that are nearly as good ({ranked[0].score:.2f} and "
            f"{ranked[1].score:.2f} of 1, {away:.0f} m and {abs(turn):.0f} degrees apart)",
            "register",
            expected="origin with heading_deg, a smaller search_m or search_deg, or control_points",
        )
    if ranked[0].score < _LEAST_SCORE:
        raise complaint(
            source,
            f"does not look like the map: agreement {ranked[0].score:.2f} of 1",
            "register",
            expected="a model of this place, scale: true, or control_points",
        )
    parts = [] if found is None else [("outlines of buildings", found.all_median_m)]
    parts += [] if fit is None else [("ground", fit.median_m)]
    for what, residual in parts:
        if residual > spec.worst_residual_m:
            raise complaint(
                source,
                f"is registered with a residual of {residual:.2f} m to the {what} (median)",
                "register",
                expected=f"at most worst_residual_m: {spec.worst_residual_m:g}",
            )


def _lines(report: dict[str, object]) -> tuple[str, ...]:
    shift = report["shift_m"]
    assert isinstance(shift, list)
    lines = [
        f"moved {shift[0]:+.2f} m east, {shift[1]:+.2f} m north",
        f"turned {report['turn_deg']:+.2f}°, scale {report['scale']:.5g}",
        f"agreement {report['score']:.2f} of 1, second best {report['second_best']:.0%} of that",
    ]
    for name in ("outlines", "ground"):
        part = report.get(name)
        if isinstance(part, dict):
            lines.append(f"{name}: median {part['median_m']:.2f} m, P95 {part['p95_m']:.2f} m")
    return tuple(lines)
