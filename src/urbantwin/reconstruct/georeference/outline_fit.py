"""Refinement in plan: fit of a model's walls to the outlines of mapped buildings."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.reconstruct.georeference.correlation import Candidate
from urbantwin.reconstruct.georeference.plan_features import PlanFeatures
from urbantwin.reconstruct.surroundings import Surroundings

__all__ = ["Agreement", "Outlines", "agreement", "fit_outlines"]

_STEP_M = 0.25
#: Minimum alignment of a wall with an outline: cosine of 25 degrees.
_ALONG = 0.906
#: Maximum distance of matched walls and outlines per iteration, coarse to fine, metres.
_REACHES_M = (6.0, 6.0, 4.0, 4.0, 3.0, 3.0, 2.0, 2.0, 1.5, 1.5, 1.0, 1.0, 0.7, 0.7, 0.5, 0.5, 0.5)
_CLOSE_M = 1.0


@dataclass(frozen=True, eq=False)
class Outlines:
    """Points along the outlines of buildings.

    Attributes:
        points: (P, 2) site frame, metres.
        normals: (P, 2) unit normals, outward.
        tree: search tree of the points.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    tree: cKDTree

    @classmethod
    def of(cls, surroundings: Surroundings) -> Outlines | None:
        """Return the outer outlines in the region; walls between two buildings are invisible."""
        shape = shapely.union_all(list(surroundings.footprints))
        rings = [
            ring
            for part in shapely.get_parts(shape)
            if part.geom_type == "Polygon"
            for ring in (part.exterior, *part.interiors)
        ]
        points, normals = [], []
        for ring in rings:
            xy = shapely.get_coordinates(ring)
            if shapely.is_ccw(ring):
                xy = xy[::-1]
            step = np.diff(xy, axis=0)
            length = np.hypot(*step.T)
            kept = length > 1e-6
            start, step, length = xy[:-1][kept], step[kept], length[kept]
            count = np.maximum(1, np.round(length / _STEP_M).astype(np.int64))
            of = np.repeat(np.arange(len(count)), count)
            within = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
            share = (within + 0.5) / count[of]
            points.append(start[of] + share[:, None] * step[of])
            along = step / length[:, None]
            normals.append(np.column_stack([-along[:, 1], along[:, 0]])[of])
        if not points:
            return None
        at, facing = np.vstack(points), np.vstack(normals)
        shapely.prepare(surroundings.region)
        inside = shapely.contains_xy(surroundings.region, at[:, 0], at[:, 1])
        if inside.sum() < 40:
            return None
        return cls(at[inside], facing[inside], cKDTree(at[inside]))


@dataclass(frozen=True)
class Agreement:
    """Agreement of walls and outlines.

    Attributes:
        score: 0 to 1: the harmonic mean of the shares of walls with an outline and of outlines with
            a wall, each weighted by distance (0.37 at one metre).
        median_m, p95_m: distance from outlines to the nearest wall, for those with one within three
            metres.
        walled: share of the outlines, where the model has points, with a wall within a metre.
        all_median_m: median over all outlines where the model has points.
    """

    score: float
    median_m: float
    p95_m: float
    walled: float
    all_median_m: float


def fit_outlines(
    features: PlanFeatures,
    outlines: Outlines,
    first: Candidate,
    pivot: NDArray[np.float64],
    *,
    with_scale: bool,
    most: int,
    patient: bool = False,
) -> Candidate:
    """Refine a candidate by iteratively fitting walls to the nearest outlines.

    Point-to-line ICP (Y. Chen, G. Medioni, "Object modelling by registration of multiple range
    images", 1992) with robust weights (Geman-McClure).

    Args:
        features: the model.
        outlines: the map.
        first: initial placement.
        pivot: (2,) pivot of ``first``.
        with_scale: whether the scale is refined, too.
        most: maximum number of walls used.
        patient: adapt the reach to the overall deviation of the walls: suited to an inexact map, in
            which some of the houses would otherwise dominate, but not among trees.
    """
    step = max(1, len(features.walls) // most)
    walls = features.walls[::step] - pivot
    facing = None if features.wall_normals is None else features.wall_normals[::step]
    at, spread = first, 0.0
    for planned in _REACHES_M:
        reach = max(planned, 2.5 * spread) if patient else planned
        turned = _turned(walls, at)
        distance, nearest = outlines.tree.query(turned, distance_upper_bound=2 * reach)
        pair = np.flatnonzero(np.isfinite(distance))
        if facing is not None and len(pair):
            way = _rotated(facing[pair], at.yaw)
            dot = np.abs(np.einsum("ij,ij->i", way, outlines.normals[nearest[pair]]))
            pair = pair[dot > _ALONG]
        if len(pair) < 20:
            return at
        q, n = outlines.points[nearest[pair]], outlines.normals[nearest[pair]]
        p = turned[pair]
        error = np.einsum("ij,ij->i", q - p, n)
        spread = 1.4826 * float(np.median(np.abs(error)))
        weight = 1.0 / (1.0 + (error / (0.5 * reach)) ** 2) ** 2
        arm = p - [at.x, at.y]
        terms = [n[:, 0], n[:, 1], n[:, 1] * arm[:, 0] - n[:, 0] * arm[:, 1]]
        if with_scale:
            terms.append(np.einsum("ij,ij->i", n, arm))
        matrix = np.column_stack(terms)
        normal = matrix.T @ (matrix * weight[:, None])
        # Parallel outlines do not determine a shift along them, which is not guessed.
        normal += 1e-6 * np.trace(normal) * np.diag([1.0, 1.0, *[100.0] * (len(terms) - 2)])
        change = np.linalg.solve(normal, matrix.T @ (error * weight))
        at = replace(
            at,
            x=at.x + float(change[0]),
            y=at.y + float(change[1]),
            yaw=at.yaw + float(change[2]),
            scale=at.scale * float(np.exp(change[3])) if with_scale else at.scale,
        )
    return at


def agreement(
    features: PlanFeatures,
    outlines: Outlines,
    at: Candidate,
    pivot: NDArray[np.float64],
    surroundings: Surroundings,
) -> Agreement:
    """Return the agreement of walls and outlines."""
    walls = _turned(features.walls - pivot, at)
    shapely.prepare(surroundings.region)
    kept = shapely.contains_xy(surroundings.region, walls[:, 0], walls[:, 1])
    seen = _turned(np.vstack([features.tall, features.low]) - pivot, at)
    reach = 1.5 * features.cell_m * at.scale + 0.5
    near, _ = cKDTree(seen).query(outlines.points, distance_upper_bound=reach)
    looked = np.isfinite(near)
    if kept.sum() < 20 or looked.sum() < 20:
        return Agreement(0.0, np.inf, np.inf, 0.0, np.inf)
    out, nearest = outlines.tree.query(walls[kept])
    share = np.exp(-((out / _CLOSE_M) ** 2))
    if features.wall_normals is not None:
        way = _rotated(features.wall_normals[kept], at.yaw)
        dot = np.abs(np.einsum("ij,ij->i", way, outlines.normals[nearest]))
        share = share * (dot > _ALONG)
    back, _ = cKDTree(walls).query(outlines.points[looked])
    precision, recall = float(share.mean()), float(np.exp(-((back / _CLOSE_M) ** 2)).mean())
    score = 2 * precision * recall / max(1e-9, precision + recall)
    close = back[back < 3.0]
    if not len(close):
        return Agreement(score, np.inf, np.inf, 0.0, float(np.median(back)))
    return Agreement(
        score,
        float(np.median(close)),
        float(np.quantile(close, 0.95)),
        float((back < _CLOSE_M).mean()),
        float(np.median(back)),
    )


def _turned(points: NDArray[np.float64], at: Candidate) -> NDArray[np.float64]:
    return np.asarray(at.scale * _rotated(points, at.yaw) + [at.x, at.y])


def _rotated(vectors: NDArray[np.float64], yaw: float) -> NDArray[np.float64]:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.asarray(vectors @ np.array([[c, s], [-s, c]]))
