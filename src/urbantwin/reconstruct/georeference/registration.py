"""Registration of a model to the ground, the roads and the outlines of buildings.

Coarse to fine: levelling; correlation with the map in plan over headings, shifts and, if enabled,
scales; the best few again in finer cells; walls to outlines; ground to ground. The best must be
clearly better than the second best, otherwise an error is raised.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.ground import Elevation
from urbantwin.io.model import ImportedModel
from urbantwin.progress import Progress, untold
from urbantwin.reconstruct.georeference.correlation import Candidate, MapRaster
from urbantwin.reconstruct.georeference.ground_level import Samples, height_at_anchor, samples_of
from urbantwin.reconstruct.georeference.levelling import GroundFit, fit_ground, upright
from urbantwin.reconstruct.georeference.outline_fit import Agreement
from urbantwin.reconstruct.georeference.pose_search import Freedom, Search, coarse_cell
from urbantwin.reconstruct.georeference.similarity import Similarity
from urbantwin.reconstruct.georeference.source_error import source_error
from urbantwin.reconstruct.surroundings import Surroundings
from urbantwin.site.geometry import GeometrySource

__all__ = ["Registration", "register"]


#: Ratio of the second-best score to the best above which the result is ambiguous.
AMBIGUOUS = 0.85
#: Minimum agreement of a valid registration.
_LEAST_SCORE = 0.15
#: Tilt from which leaning walls are fitted again, degrees.
_TILT_DEG = 0.1
_MOST_SHOWN = 8_000


@dataclass(frozen=True, eq=False)
class Registration:
    """The registration of a model, and data for its picture.

    Attributes:
        transform: from the initial to the registered placement, site frame.
        report: for ``geometry.json``: shift, rotation, scale, residuals, confidence.
        before: (N, 2) walls (or edges of tall objects) at the initial placement.
        after: (N, 2) the same, registered.
        lines: summary as text lines.
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
    """Find the placement of a model on the map.

    Args:
        model: at its initial placement: z-up, metres, roughly in the site frame.
        source: its entry in ``site.yaml``.
        surroundings: the map in plan.
        elevation: the site's ground, ``None`` if unknown.
        freedom: what may be changed.
        progress: called with the fraction done (0..1) and the current step.

    Raises:
        InputError: there are no features, two placements are similarly good, or the residual is
            above ``worst_residual_m``.
    """
    tell = progress or untold
    raster = MapRaster(surroundings, coarse_cell(surroundings.region))
    if not raster.tells:
        raise source_error(
            source,
            "cannot be registered: the map has no building and no road in the region",
            "register",
            expected="control_points, or origin",
        )
    samples, bare = samples_of(model), samples_of(model, ground=True)
    levelled, notes = _levelled(samples, freedom, elevation)
    search = Search(samples, levelled, source, surroundings, freedom)
    levelled, features, ranked, best = search.run(raster, tell)
    _check_clear(source, ranked)
    tell(0.9, "laying it on the ground")
    transform = search.similarity(best).after(levelled)
    features = search.features(transform)
    fit, up = _laid(features.ground, bare, transform, elevation, freedom)
    transform = up.after(transform)
    notes["tilt_deg"] = 0.0 if fit is None else round(fit.tilt_deg, 3)
    features = search.features(transform)
    if fit is not None and fit.tilt_deg > _TILT_DEG:
        # after a tilt, walls and ground are fitted once more
        transform = search.polished(features).after(transform)
        fit, up = _laid(search.features(transform).ground, bare, transform, elevation, freedom)
        transform = up.after(transform)
        features = search.features(transform)
    found = search.agreement(features)
    report = {**_moves(transform, search.pivot), **notes, **_quality(ranked, found, fit)}
    _check_residuals(source, found, fit)
    step = max(1, len(features.walls) // _MOST_SHOWN)
    after = features.walls[::step]
    return Registration(transform, report, _before(after, transform), after, _lines(report))


def _levelled(
    samples: Samples, freedom: Freedom, elevation: Elevation | None
) -> tuple[Similarity, dict[str, object]]:
    """Return the levelling of a model without a stated up axis."""
    still = Similarity(1.0, np.eye(3), np.zeros(3))
    if not freedom.level:
        return still, {}
    turn, angle, over = upright(samples)
    # streets may slope by a few degrees, which is kept without a DEM
    if angle < (0.2 if elevation is not None else 6.0):
        return still, {}
    return turn, {"levelled_deg": round(angle, 2), "turned_over": over}


def _laid(
    ground: NDArray[np.float64],
    bare: Samples,
    transform: Similarity,
    elevation: Elevation | None,
    freedom: Freedom,
) -> tuple[GroundFit | None, Similarity]:
    """Fit a model, registered in plan, to the site's ground, or move it to z = 0 at the anchor."""
    if elevation is not None:
        fit = fit_ground(ground, elevation, tilt=freedom.place or freedom.heading or freedom.level)
        if fit is not None:
            return fit, fit.transform
    if not freedom.height:
        return None, Similarity(1.0, np.eye(3), np.zeros(3))
    own = height_at_anchor(bare.moved(transform))
    return None, Similarity(1.0, np.eye(3), np.array([0.0, 0.0, -(own or 0.0)]))


def _before(after: NDArray[np.float64], transform: Similarity) -> NDArray[np.float64]:
    """Return the initial positions of registered points in plan, without the tilt."""
    scale, turn = transform.scale, transform.rotation[:2, :2]
    return np.asarray(np.linalg.solve(turn * scale, (after - transform.translation[:2]).T).T)


def _moves(transform: Similarity, pivot: NDArray[np.float64]) -> dict[str, object]:
    shift = transform.apply(np.array([[*pivot, 0.0]]))[0, :2] - pivot
    yaw = np.degrees(np.arctan2(transform.rotation[1, 0], transform.rotation[0, 0]))
    return {
        "shift_m": np.round(shift, 3).tolist(),
        "turn_deg": round(float(yaw), 3),
        "scale": float(f"{transform.scale:.6g}"),
    }


def _quality(
    ranked: list[Candidate], found: Agreement | None, fit: GroundFit | None
) -> dict[str, object]:
    second = ranked[1].score / max(1e-9, ranked[0].score) if len(ranked) > 1 else 0.0
    report: dict[str, object] = {
        "score": round(ranked[0].score, 3),
        "second_best": round(max(0.0, second), 3),
        "confidence": round(1.0 - max(0.0, second), 3),
        "outlines": "not known: neither the model's walls nor the map's buildings were enough",
        "ground": "not known: only the height at the anchor",
    }
    if found is not None:
        report["outlines"] = {
            "median_m": round(found.median_m, 3),
            "p95_m": round(found.p95_m, 3),
            "share_with_a_wall": round(found.walled, 3),
        }
    if fit is not None:
        report["ground"] = {"median_m": round(fit.median_m, 3), "p95_m": round(fit.p95_m, 3)}
    return report


def _check_clear(source: GeometrySource, ranked: list[Candidate]) -> None:
    """Raise an error if the registration is weak or ambiguous."""
    first = ranked[0]
    if first.score < _LEAST_SCORE:
        raise source_error(
            source,
            f"does not look like the map: agreement {first.score:.2f} of 1",
            "register",
            expected="a model of this place, scale: true, or control_points",
        )
    if len(ranked) > 1 and ranked[1].score > AMBIGUOUS * first.score:
        turn = np.degrees(np.angle(np.exp(1j * (ranked[1].yaw - first.yaw))))
        away = np.hypot(ranked[1].x - first.x, ranked[1].y - first.y)
        raise source_error(
            source,
            f"fits the map in two ways that are nearly as good ({first.score:.2f} and "
            f"{ranked[1].score:.2f} of 1, {away:.0f} m and {abs(turn):.0f} degrees apart)",
            "register",
            expected="origin with heading_deg, a smaller search_m or search_deg, or control_points",
        )


def _check_residuals(
    source: GeometrySource, found: Agreement | None, fit: GroundFit | None
) -> None:
    spec = source.spec.register_to
    assert spec is not None
    parts = [] if found is None else [("outlines of buildings", found.all_median_m)]
    parts += [] if fit is None else [("ground", fit.median_m)]
    for what, residual in parts:
        if residual > spec.worst_residual_m:
            raise source_error(
                source,
                f"is registered with a residual of {residual:.2f} m to the {what} (median)",
                "register",
                expected=f"at most worst_residual_m: {spec.worst_residual_m:g}",
            )


def _lines(report: dict[str, object]) -> tuple[str, ...]:
    shift = report["shift_m"]
    assert isinstance(shift, list)
    lines = [
        f"moved {shift[0]:+.2f} m east, {shift[1]:+.2f} m north, "
        f"turned {report['turn_deg']:+.2f}°, scale {report['scale']:.5g}",
        f"agreement {report['score']:.2f} of 1, second best {report['second_best']:.0%} of that",
    ]
    for name in ("outlines", "ground"):
        part = report.get(name)
        if isinstance(part, dict):
            lines.append(f"{name}: median {part['median_m']:.2f} m, P95 {part['p95_m']:.2f} m")
    return tuple(lines)
