"""Loss terms of returns from surfaces that twin and data share: dropout, noise, intensity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.stats import binom, chi2

from urbantwin.fidelity.tuning.frames import Looks
from urbantwin.fidelity.tuning.knobs import Values
from urbantwin.fidelity.tuning.loss import SECTORS, Loss
from urbantwin.fidelity.tuning.prediction import Answers, BeamView
from urbantwin.fidelity.tuning.tuned_rig import PointsIn, frame_of_points, tuned_rig
from urbantwin.lidar import Rig
from urbantwin.taxonomy import materials

__all__ = ["LEAST_CELLS", "ReturnTerms"]

#: Beams of one channel per cell, columns.
_TOGETHER = 8
#: Maximum number of beams per sensor.
_BEAMS = 32_768
#: Tolerance of a return's range from the twin's surface, metres and share of the range.
_SAME_M, _SAME_SHARE = 0.3, 0.01
#: Maximum relative difference of ranges within a cell.
_SMOOTH = 0.15
#: Minimum number of returns that confirm the surface of a cell.
_LEAST_RETURNS = 3
#: Minimum share of a cell's returns on the surface.
_AGREE = 0.8
#: Maximum share of frames in which traffic hides a cell.
_HIDDEN = 0.5
#: Minimum number of cells of a fitted material.
LEAST_CELLS = 12
#: Minimum distance, in multiples of the distance within which the sensor's intensity is reduced.
#: Nearer, intensities are reduced by more than a fifth, by an amount that depends on the unit.
_FOCUS = 1.4
#: Offset of intensities before taking the logarithm, for dark surfaces.
_DARK = 0.01
#: Cost of a reflectivity or intensity factor, relative to a loss of 1 of all materials: only the
#: product of both is observable, and few deviating materials are more likely.
_FACTOR_COST = 0.1


@dataclass(frozen=True, eq=False)
class _Cells:
    """Real returns in the cells of one sensor.

    Attributes:
        beams: (C, T) beam indices of the cells.
        sector: (C,) azimuth sector.
        material: (C,) common material of the beams, -1 if they differ.
        looks: (C,) number of firings while no traffic hid the surface.
        returns: (C,) number of returns.
        scatter: (C,) pooled variance of the ranges, m^2; NaN if unknown.
        freedom: (C,) its degrees of freedom.
        intensity: (C,) mean of the returns, 0..1; NaN without intensity.
        in_focus: (C,) whether the range is large enough for intensities that do not vary by unit.
    """

    beams: NDArray[np.int64]
    sector: NDArray[np.int64]
    material: NDArray[np.int64]
    looks: NDArray[np.float64]
    returns: NDArray[np.float64]
    scatter: NDArray[np.float64]
    freedom: NDArray[np.float64]
    intensity: NDArray[np.float64]
    in_focus: NDArray[np.bool_]


class ReturnTerms:
    """Loss terms of the parameters of dropout, noise and reflectivity.

    Neighbouring beams of a channel form a cell if the twin has one smooth surface in front of all
    of them. A cell is used if real returns lie on that surface; frames in which an object hides it
    are left out of the cell.

    - **dropout**: the likelihood of the number of returns of a cell, given that there are enough to
      confirm the surface (a truncated binomial).
    - **noise**: the log ratio of the pooled standard deviation of a beam's ranges to the model's.
    - **reflectivity**: the log ratio of the mean intensity to the model's, with equal weight of
      every material.

    Args:
        looks: real points.
        rig: the rig with its sensors at their poses.
        views: surfaces hit by its sensors.
        points_in: frame of the real points.
    """

    def __init__(
        self, looks: Looks, rig: Rig, views: Sequence[BeamView], points_in: PointsIn
    ) -> None:
        self._rig, self._views = rig, views
        place = frame_of_points(rig, points_in)
        self._cells = []
        for number, (one, view) in enumerate(zip(rig.sensors, views, strict=True)):
            mine = np.flatnonzero(looks.sensor == number)
            sensor_SE3_points = one.site_SE3_sensor.inverse() @ place
            light = None if looks.intensity is None else looks.intensity[mine]
            self._cells.append(
                _cells_of(
                    sensor_SE3_points.apply(looks.points[mine]),
                    light,
                    looks.frame[mine],
                    looks.frames,
                    view,
                    one.calibration.range_offset_m,
                )
            )
        #: Number of cells.
        self.cells = sum(len(one.beams) for one in self._cells)
        counted = np.bincount(
            np.concatenate([one.material[one.material >= 0] for one in self._cells]),
            minlength=len(materials()),
        )
        #: Names of the materials with enough cells.
        self.materials = tuple(
            name for name, count in zip(materials(), counted, strict=True) if count >= LEAST_CELLS
        )

    def dropout(self, values: Values) -> Loss:
        """Return the mean negative log likelihood of a cell's returns."""
        losses, weights, sectors = [], [], []
        for cells, answers in self._answered(values):
            share = answers.share.reshape(cells.beams.shape).mean(axis=1).clip(1e-4, 1 - 1e-4)
            likely = binom.logpmf(cells.returns, cells.looks, share) - binom.logsf(
                _LEAST_RETURNS - 1, cells.looks, share
            )
            losses.append(-likely.clip(-50.0, None))
            weights.append(np.ones(len(share)))
            sectors.append(cells.sector)
        return _joined(losses, weights, sectors)

    def noise(self, values: Values) -> Loss:
        """Return the mean absolute log ratio of standard deviations."""
        losses, weights, sectors = [], [], []
        for cells, answers in self._answered(values):
            fit = np.isfinite(cells.scatter)
            # Beams with few returns are the noisiest, and contribute little.
            weight = answers.share.reshape(cells.beams.shape) + 1e-6
            square = (answers.sigma_m**2).reshape(cells.beams.shape)
            model = ((square * weight).sum(axis=1) / weight.sum(axis=1))[fit]
            median = chi2.median(cells.freedom[fit]) / cells.freedom[fit]
            losses.append(np.abs(np.log(cells.scatter[fit] / (model * median))) / 2)
            weights.append(np.ones(int(fit.sum())))
            sectors.append(cells.sector[fit])
        return _joined(losses, weights, sectors)

    def reflectivity(self, values: Values) -> Loss:
        """Return the mean absolute log ratio of intensities."""
        losses, weights, sectors = [], [], []
        for cells, answers in self._answered(values):
            shape = cells.beams.shape
            weight = answers.share.reshape(shape) + 1e-6
            model = (answers.intensity.reshape(shape) * weight).sum(axis=1) / weight.sum(axis=1)
            number = {name: k for k, name in enumerate(materials())}
            known = np.array([number[name] for name in self.materials], np.int64)
            fit = np.isfinite(cells.intensity) & np.isin(cells.material, known) & cells.in_focus
            losses.append(np.abs(np.log((cells.intensity + _DARK) / (model + _DARK)))[fit])
            weights.append(cells.material[fit].astype(np.float64))
            sectors.append(cells.sector[fit])
        if sum(len(one) for one in losses):
            material = np.concatenate(weights).astype(np.int64)
            count = np.bincount(material)[material] * len(np.unique(material))
            shares = np.split(1.0 / count, np.cumsum([len(one) for one in losses])[:-1])
            found = _joined(losses, list(shares), sectors)
        else:
            found = _joined(losses, weights, sectors)
        return self._with_cost(found, values)

    def _with_cost(self, found: Loss, values: Values) -> Loss:
        factors = [
            abs(np.log(value))
            for name, value in values.items()
            if name.startswith("reflectivity.") or name.endswith(".intensity")
        ]
        if not factors or not found.weight.sum():
            return found
        cost = _FACTOR_COST * float(np.sum(factors)) / max(len(self.materials), 1)
        return Loss(found.total + cost * found.weight, found.weight)

    def _answered(self, values: Values) -> list[tuple[_Cells, Answers]]:
        rig = tuned_rig(self._rig, {k: v for k, v in values.items() if not k.startswith("move.")})
        return [
            (cells, view.answers(one, cells.beams.ravel()))
            for one, view, cells in zip(rig.sensors, self._views, self._cells, strict=True)
        ]


def _joined(
    losses: list[NDArray[np.float64]],
    weights: list[NDArray[np.float64]],
    sectors: list[NDArray[np.int64]],
) -> Loss:
    return Loss.of(np.concatenate(losses), np.concatenate(weights), np.concatenate(sectors))


def _cells_of(
    points: NDArray[np.float64],
    light: NDArray[np.float64] | None,
    frame: NDArray[np.int64],
    frames: int,
    view: BeamView,
    offset_m: float,
) -> _Cells:
    """Assign real points of one sensor, in its frame, to the cells of its beams."""
    beams, sector = _smooth_cells(view)
    cell_of = np.full(len(view.directions), -1, np.int64)
    cell_of[beams.ravel()] = np.repeat(np.arange(len(beams)), beams.shape[1])
    away = np.linalg.norm(points, axis=1)
    _, beam = cKDTree(view.directions).query(points / np.maximum(away, 1e-9)[:, None])
    rows = np.flatnonzero(cell_of[beam] >= 0)
    beam, away, frame = beam[rows], away[rows] - offset_m, frame[rows]
    cell = cell_of[beam]
    known = view.range_m[beam].astype(np.float64)
    on = np.abs(away - known) < _SAME_M + _SAME_SHARE * known

    count = len(beams)
    hidden = np.zeros((count, frames), np.bool_)
    hidden[cell[~on & (away < known)], frame[~on & (away < known)]] = True
    other = np.bincount(cell[~on & (away >= known)], minlength=count)
    on &= ~hidden[cell, frame]
    returns = np.bincount(cell[on], minlength=count).astype(np.float64)
    seen = frames - hidden.sum(axis=1)
    looks = (seen * beams.shape[1]).astype(np.float64)
    returns = np.minimum(returns, looks)
    good = (
        (returns >= _LEAST_RETURNS)
        & (returns >= _AGREE * (returns + other))
        & (seen >= (1 - _HIDDEN) * frames)
    )
    scatter, freedom = _scatter(cell[on], beam[on], (away - known)[on], count, frames)
    intensity = np.full(count, np.nan)
    if light is not None:
        total = np.bincount(cell[on], light[rows][on], minlength=count)
        intensity = np.where(returns > 0, total / np.maximum(returns, 1), np.nan)
    material = view.material[beams]
    alone = (material == material[:, :1]).all(axis=1)
    return _Cells(
        beams[good],
        sector[good],
        np.where(alone, material[:, 0], -1)[good],
        looks[good],
        returns[good],
        scatter[good],
        freedom[good],
        intensity[good],
        view.range_m[beams].min(axis=1)[good] >= _FOCUS * (view.mounted.sensor.overlap_m or 0.0),
    )


def _smooth_cells(view: BeamView) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return beams (C, T) of cells with one smooth surface, and their sectors (C,)."""
    columns = view.columns // _TOGETHER * _TOGETHER
    channels = len(view.directions) // view.columns
    grid = np.arange(channels)[:, None] * view.columns + np.arange(columns)
    cells = grid.reshape(channels, -1, _TOGETHER)
    every = max(1, int(np.ceil(channels * columns / _BEAMS)))
    beams = cells[:, ::every].reshape(-1, _TOGETHER)
    range_m = view.range_m[beams]
    smooth = (range_m.min(axis=1) > 0) & (
        range_m.max(axis=1) < (1 + _SMOOTH) * np.maximum(range_m.min(axis=1), 1e-6)
    )
    beams = beams[smooth]
    sector = (beams[:, 0] % view.columns) * SECTORS // view.columns
    return beams, sector


def _scatter(
    cell: NDArray[np.int64],
    beam: NDArray[np.int64],
    apart: NDArray[np.float64],
    count: int,
    frames: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the pooled variance (C,) of ranges about their beam's mean, and its freedom."""
    group = beam if frames > 1 else cell
    _, group = np.unique(group, return_inverse=True)
    inside = np.bincount(group)
    middle = np.bincount(group, apart) / inside
    square = np.bincount(cell, (apart - middle[group]) ** 2, minlength=count)
    owner = np.zeros(len(inside), np.int64)
    owner[group] = cell
    freedom = np.bincount(owner, inside - 1.0, minlength=count)
    with np.errstate(invalid="ignore", divide="ignore"):
        variance = np.where(freedom >= _LEAST_RETURNS, square / freedom, np.nan)
    return np.maximum(variance, 1e-8), freedom.astype(np.float64)
