"""Search for a model's position on a map by correlation over shifts, headings and scales.

Masked normalised cross-correlation by the fast Fourier transform: D. Padfield, "Masked object
registration in the Fourier domain", IEEE Trans. Image Processing 21(5), 2012.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.fft import irfft2, next_fast_len, rfft2
from scipy.ndimage import gaussian_filter

from urbantwin.reconstruct.georeference.plan_features import PlanFeatures
from urbantwin.reconstruct.surroundings import Surroundings

__all__ = ["Candidate", "MapRaster", "candidates"]

#: Minimum overlap, as a share of the largest possible overlap of model and map.
_LEAST_OVERLAP = 0.35
#: Differences below which candidates are the same: metres, degrees, share of scale.
APART_M, APART_DEG, APART_SCALE = 6.0, 8.0, 0.06
_PEAKS_PER_HEADING = 3
#: Weight of roads against buildings as evidence against tall objects: trees may stand elsewhere.
_ROAD = 0.35


@dataclass(frozen=True)
class Candidate:
    """One placement of a model on the map: ``site = scale Rz(yaw) (model - pivot) + place``.

    Attributes:
        score: correlation, -1 to 1.
        yaw: radians, counter-clockwise.
        x, y: position of the pivot, site frame, metres.
        scale: scale of the model.
    """

    score: float
    yaw: float
    x: float
    y: float
    scale: float = 1.0

    def near(self, other: Candidate, reach_m: float = APART_M) -> bool:
        """Return whether both placements are approximately the same."""
        turn = np.degrees(np.abs(np.angle(np.exp(1j * (self.yaw - other.yaw)))))
        return bool(
            np.hypot(self.x - other.x, self.y - other.y) < reach_m
            and turn < APART_DEG
            and abs(np.log(self.scale / other.scale)) < APART_SCALE
        )


class MapRaster:
    """The map in plan: positive on buildings, negative on roads, known within the region."""

    def __init__(self, surroundings: Surroundings, cell: float) -> None:
        self.cell = cell
        west, south, east, north = shapely.bounds(surroundings.region)
        self.corner = np.array([west, south]) - cell
        self.shape = (int((north - south) / cell) + 3, int((east - west) / cell) + 3)
        rows, columns = np.mgrid[: self.shape[0], : self.shape[1]]
        x, y = (
            self.corner[0] + (columns.ravel() + 0.5) * cell,
            self.corner[1] + (rows.ravel() + 0.5) * cell,
        )

        def inside(shape: shapely.Geometry) -> NDArray[np.float64]:
            if shapely.is_empty(shape):
                return np.zeros(self.shape)
            shapely.prepare(shape)
            mask = shapely.contains_xy(shape, x, y).reshape(self.shape)
            return np.asarray(mask, np.float64)

        buildings = shapely.union_all(list(surroundings.footprints))
        self.known = inside(surroundings.region)
        value = inside(buildings) - _ROAD * inside(surroundings.roads)
        self.value = gaussian_filter(value, 0.7) * self.known

    @property
    def tells(self) -> bool:
        """Whether the map has any contrast."""
        return bool(self.known.any() and np.ptp(self.value[self.known > 0]) > 0)


def candidates(
    features: PlanFeatures,
    raster: MapRaster,
    pivot: NDArray[np.float64],
    centre: NDArray[np.float64],
    *,
    reach_m: float,
    yaws: NDArray[np.float64],
    scales: NDArray[np.float64],
    most: int,
) -> list[Candidate]:
    """Return the best placements of a model on the map, best first.

    Args:
        features: the model.
        raster: the map.
        pivot: (2,) point of the model about which it is rotated and scaled.
        centre: (2,) initial position of the pivot, site frame.
        reach_m: maximum shift from there, metres.
        yaws: headings to test, radians.
        scales: scales to test.
        most: maximum number of placements.
    """
    found: list[Candidate] = []
    for scale in scales:
        search = _Search(features, raster, pivot, centre, reach_m, float(scale))
        for yaw in yaws:
            found += search.peaks(float(yaw))
    found.sort(key=lambda one: (-one.score, one.yaw, one.x, one.y, one.scale))
    kept: list[Candidate] = []
    for one in found:
        if len(kept) >= most:
            break
        if not any(one.near(other) for other in kept):
            kept.append(one)
    return kept


class _Search:
    """Correlations of one scale."""

    def __init__(
        self,
        features: PlanFeatures,
        raster: MapRaster,
        pivot: NDArray[np.float64],
        centre: NDArray[np.float64],
        reach_m: float,
        scale: float,
    ) -> None:
        self._raster, self._centre, self._reach, self._scale = raster, centre, reach_m, scale
        both = np.vstack([features.tall, features.low])
        self._points = (both - pivot) * scale
        self._is_tall = np.arange(len(both)) < len(features.tall)
        # Points farther from the pivot than the map's extent can never be on it.
        size = np.array(raster.shape) * raster.cell
        far = float(np.hypot(*size)) + reach_m + float(np.hypot(*(centre - raster.corner)))
        near = np.hypot(*self._points.T) < far
        self._points, self._is_tall = self._points[near], self._is_tall[near]
        radius = float(np.hypot(*self._points.T).max(initial=1.0))
        self._half = int(radius / raster.cell) + 2
        full = [n + 2 * self._half + 1 for n in raster.shape]
        self._shape = (next_fast_len(full[0], real=True), next_fast_len(full[1], real=True))
        known, value = raster.known.astype(np.float32), raster.value.astype(np.float32)
        self._map = [rfft2(one, self._shape) for one in (known, value, value * value)]
        # A model cell larger than the map's covers several.
        self._cover = features.cell_m * scale / raster.cell

    def peaks(self, yaw: float) -> list[Candidate]:
        """Return the best shifts at a heading."""
        c, s = np.cos(yaw), np.sin(yaw)
        cell, half = self._raster.cell, self._half
        xy = self._points @ np.array([[c, s], [-s, c]])
        column, row = np.floor(xy / cell + 0.5).astype(np.int64).T + half
        side = 2 * half + 1
        place = row * side + column
        seen = np.bincount(place, minlength=side * side).reshape(side, side).astype(np.float64)
        tall = np.bincount(place[self._is_tall], minlength=side * side).reshape(side, side)
        share = np.divide(tall, seen, out=np.zeros_like(seen), where=seen > 0)
        mask = (seen > 0).astype(np.float32)
        share = share.astype(np.float32)
        if self._cover > 1.0:
            blur = 0.5 * self._cover
            mask, share = gaussian_filter(mask, blur), gaussian_filter(share, blur)
        o, m, mm = (np.conj(rfft2(one, self._shape)) for one in (mask, share, share * share))
        known, value, square = self._map
        n, sm, smm, sw, sww, smw = (
            irfft2(one, self._shape)
            for one in (o * known, m * known, mm * known, o * value, o * square, m * value)
        )
        n = np.maximum(n, 1e-9)
        top = smw - sm * sw / n
        below = np.maximum(smm - sm * sm / n, 0) * np.maximum(sww - sw * sw / n, 0)
        share_of_most = n / max(1.0, min(mask.sum(), self._raster.known.sum()))
        floor = 1e-3 * float(n.max()) ** 2
        score = np.where(below > floor * 1e-3, top / np.sqrt(np.maximum(below, 1e-12)), -1.0)
        score *= np.minimum(1.0, share_of_most / 0.7)
        score[share_of_most < _LEAST_OVERLAP] = -1.0
        # The shift of the model's array within the map's gives the position of its pivot.
        rows, columns = (
            np.where(np.arange(whole) < own, np.arange(whole), np.arange(whole) - whole)
            for whole, own in zip(self._shape, self._raster.shape, strict=True)
        )
        y = self._raster.corner[1] + (rows + half + 0.5) * cell
        x = self._raster.corner[0] + (columns + half + 0.5) * cell
        out_of_reach = np.hypot(x[None] - self._centre[0], y[:, None] - self._centre[1])
        score[~(out_of_reach <= self._reach + cell)] = -1.0
        return self._best(score, x, y, yaw)

    def _best(
        self,
        score: NDArray[np.float64],
        x: NDArray[np.float64],
        y: NDArray[np.float64],
        yaw: float,
    ) -> list[Candidate]:
        out: list[Candidate] = []
        guard = max(1, int(APART_M / self._raster.cell))
        for _ in range(_PEAKS_PER_HEADING):
            row, column = np.unravel_index(int(np.argmax(score)), score.shape)
            best = float(score[row, column])
            if best <= 0:
                break
            out.append(Candidate(best, yaw, float(x[column]), float(y[row]), self._scale))
            around = (
                np.arange(row - guard, row + guard + 1) % score.shape[0],
                np.arange(column - guard, column + guard + 1) % score.shape[1],
            )
            score[np.ix_(*around)] = -1.0
        return out
