"""Coarse-to-fine search for a model's pose on the map: cells, then walls and outlines."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.progress import Progress
from urbantwin.reconstruct.georeference.correlation import (
    APART_M,
    Candidate,
    MapRaster,
    candidates,
)
from urbantwin.reconstruct.georeference.ground_level import Samples
from urbantwin.reconstruct.georeference.outline_fit import (
    Agreement,
    Outlines,
    agreement,
    fit_outlines,
)
from urbantwin.reconstruct.georeference.plan_features import PlanFeatures, plan_features
from urbantwin.reconstruct.georeference.similarity import Similarity
from urbantwin.reconstruct.georeference.source_error import source_error
from urbantwin.reconstruct.surroundings import Surroundings
from urbantwin.site.geometry import GeometrySource

__all__ = ["Freedom", "Search", "coarse_cell"]


_FINE_M = 2.0
#: Maximum search range around a known heading, degrees, unless site.yaml states more.
_KNOWN_HEADING_DEG = 5.0
_CANDIDATES = 10
#: Size of a model relative to the region: a third to three times.
_WIDEST = 3.0
#: Steps of the wide search: of the logarithm of the scale, and of the heading in degrees; heading
#: step of the normal search.
_SCALE_STEP, _WIDE_STEP_DEG, _STEP_DEG = 0.045, 5.0, 3.0
#: Factor of the cell size in a search over scales.
_WIDE_CELLS = 1.5
_LEAST_WALLS = 50
_WIDE_PEAK_M = 20.0


@dataclass(frozen=True, eq=False)
class Freedom:
    """The unknown parts of a model's initial placement, which registration may change.

    Attributes:
        heading: search any heading; otherwise a few degrees, unless ``search_deg`` states more.
        place: search the whole site; otherwise as far as ``search_m`` states.
        scale: the unit was estimated.
        level: the up axis was estimated: the model may have to be levelled.
        height: the heights were estimated: without known ground the model may be moved to the
            anchor's height.
        pivot: (2,) pivot of rotations, site frame.
    """

    heading: bool = False
    place: bool = False
    scale: bool = False
    level: bool = False
    height: bool = False
    pivot: tuple[float, float] | None = None


class Search:
    """One search.

    Args:
        samples: points of the whole model at its initial placement: z-up, metres, roughly in the
            site frame.
        levelled: transform that levels it.
        source: its entry in ``site.yaml``.
        surroundings: the map in plan.
        freedom: what may be changed.
    """

    def __init__(
        self,
        samples: Samples,
        levelled: Similarity,
        source: GeometrySource,
        surroundings: Surroundings,
        freedom: Freedom,
    ) -> None:
        assert source.spec.register_to is not None
        self._spec = source.spec.register_to
        self._samples, self._levelled, self._source = samples, levelled, source
        self._surroundings, self._freedom = surroundings, freedom
        centroid = surroundings.region.centroid
        #: Pivot of rotations and scalings, site frame.
        self.pivot = np.array(freedom.pivot or (centroid.x, centroid.y), np.float64)
        self.outlines = Outlines.of(surroundings)

    def has_walls(self, features: PlanFeatures) -> bool:
        """Return whether there are outlines, and enough walls to fit to them."""
        return self.outlines is not None and len(features.walls) >= _LEAST_WALLS

    def run(
        self, raster: MapRaster, tell: Progress
    ) -> tuple[Similarity, PlanFeatures, list[Candidate], Candidate]:
        """Return levelling and scaling, the features, ranked placements, and the best one.

        Raises:
            InputError: nothing of the model is similar to the map.
        """
        spec, levelled = self._spec, self._levelled
        wide = spec.scale and self._freedom.scale
        if wide:
            levelled = self._scaled(self._as_large_as_the_region()).after(levelled)
        features = self.features(levelled)
        tell(0.1, "comparing it with the map")
        step = _WIDE_STEP_DEG if wide else _STEP_DEG
        if wide:
            raster = MapRaster(self._surroundings, _WIDE_CELLS * raster.cell)
        found = self._coarse(features, raster, step)
        scale = found[0].scale
        if abs(np.log(scale)) > 0.08:
            # tall objects were detected at the wrong scale
            levelled = self._scaled(scale).after(levelled)
            features = self.features(levelled)
            found = [replace(one, scale=one.scale / scale) for one in found]
        found = self._finer(features, found, step, tell)
        tell(0.8, "laying walls on outlines")
        if self.has_walls(features):
            found = [self._refined(features, one) for one in found]
        # without walls, peaks are as wide as streets
        reach = APART_M if self.has_walls(features) else _WIDE_PEAK_M
        ranked: list[Candidate] = []
        for one in sorted(found, key=lambda c: (-c.score, c.yaw, c.x, c.y)):
            if not any(one.near(other, reach) for other in ranked):
                ranked.append(one)
        best = self._fitted(features, ranked[0])
        return levelled, features, ranked, best

    def polished(self, features: PlanFeatures) -> Similarity:
        """Return a repeated fit of walls to outlines, after levelling by the ground."""
        still = Candidate(0.0, 0.0, float(self.pivot[0]), float(self.pivot[1]))
        if self.outlines is None or not self.has_walls(features):
            return self.similarity(still)
        return self.similarity(self._fitted(features, still))

    def _fitted(self, features: PlanFeatures, first: Candidate) -> Candidate:
        """Return the better fit of walls to outlines, with fixed or with adaptive reach."""
        if self.outlines is None or not self.has_walls(features):
            return first
        found = [
            fit_outlines(
                features,
                self.outlines,
                first,
                self.pivot,
                with_scale=self._spec.scale,
                most=12_000,
                patient=patient,
            )
            for patient in (False, True)
        ]
        scores = [
            agreement(features, self.outlines, one, self.pivot, self._surroundings).score
            for one in found
        ]
        return found[int(np.argmax(scores))]

    def agreement(self, features: PlanFeatures) -> Agreement | None:
        """Return the agreement of a registered model with the outlines; ``None``: too few walls."""
        if self.outlines is None or not self.has_walls(features):
            return None
        still = Candidate(0.0, 0.0, 0.0, 0.0)
        return agreement(features, self.outlines, still, np.zeros(2), self._surroundings)

    def similarity(self, at: Candidate) -> Similarity:
        """Return a candidate as a transform of the initially placed model."""
        turn = Similarity.in_plan(at.yaw, np.zeros(3), at.scale)
        shift = np.array([at.x, at.y, 0.0]) - turn.apply(np.array([[*self.pivot, 0.0]]))[0]
        return replace(turn, translation=shift)

    def features(self, transform: Similarity) -> PlanFeatures:
        """Return the features of the transformed model."""
        out = plan_features(self._samples.moved(transform))
        if len(out.tall) + len(out.low) < 50:
            raise source_error(self._source, "is too small to be registered", "register")
        return out

    def _scaled(self, scale: float) -> Similarity:
        fixed = np.array([*self.pivot, 0.0])
        return Similarity(scale, np.eye(3), fixed * (1.0 - scale))

    def _as_large_as_the_region(self) -> float:
        """Return the scale that gives a model of unknown unit the size of the region."""
        points = self._levelled.apply(self._samples.points)
        low, high = np.quantile(points[:, :2], [0.02, 0.98], axis=0)
        across = 2 * float(np.sqrt(self._surroundings.region.area / np.pi))
        return across / max(float((high - low).max()), 1e-9)

    def _coarse(
        self, features: PlanFeatures, raster: MapRaster, step_deg: float
    ) -> list[Candidate]:
        spec, reach = self._spec, self._spec.search_m
        if self._freedom.place:
            corners = shapely.get_coordinates(self._surroundings.region) - self.pivot
            reach = max(reach, float(np.hypot(corners[:, 0], corners[:, 1]).max()))
        widest = spec.search_deg
        if not self._freedom.heading and "search_deg" not in spec.model_fields_set:
            widest = min(widest, _KNOWN_HEADING_DEG)
        scales = np.ones(1)
        if spec.scale:
            # around 1, or in a wide range if the unit was estimated
            most = np.log(_WIDEST) if self._freedom.scale else 0.22
            scales = np.exp(np.linspace(-most, most, 2 * int(most / _SCALE_STEP) + 1))
        found = candidates(
            features,
            raster,
            self.pivot,
            self.pivot,
            reach_m=reach,
            yaws=_yaws(widest, step_deg),
            scales=scales,
            most=_CANDIDATES,
        )
        if not found:
            raise source_error(
                self._source,
                f"cannot be registered: nothing of it looks like the map within {reach:.0f} m and "
                f"{widest:.0f} degrees",
                "register",
                expected="a larger search_m, scale: true, or control_points",
            )
        return found

    def _finer(
        self,
        features: PlanFeatures,
        found: list[Candidate],
        step_deg: float,
        tell: Progress,
    ) -> list[Candidate]:
        raster = MapRaster(self._surroundings, _FINE_M)
        factors = np.exp(np.linspace(-0.03, 0.03, 5)) if self._spec.scale else np.ones(1)
        better: list[Candidate] = []
        for number, one in enumerate(found):
            tell(0.4 + 0.4 * number / len(found), "comparing it in detail")
            near = candidates(
                features,
                raster,
                self.pivot,
                np.array([one.x, one.y]),
                reach_m=8.0,
                yaws=one.yaw + _yaws(step_deg / 2, 1.0),
                scales=one.scale * factors,
                most=1,
            )
            better += near or [one]
        return better

    def _refined(self, features: PlanFeatures, one: Candidate) -> Candidate:
        assert self.outlines is not None
        scale = self._spec.scale
        at = fit_outlines(features, self.outlines, one, self.pivot, with_scale=scale, most=3_000)
        found = agreement(features, self.outlines, at, self.pivot, self._surroundings)
        return replace(at, score=found.score)


def coarse_cell(region: shapely.Polygon) -> float:
    """Return the cell size of the first comparison: below a house, larger for large regions."""
    west, south, east, north = shapely.bounds(region)
    return float(np.clip(max(east - west, north - south) / 75.0, 4.0, 8.0))


def _yaws(widest_deg: float, step_deg: float) -> NDArray[np.float64]:
    """Return the rotations to test, radians."""
    if widest_deg >= 180.0 - step_deg / 2:
        return np.asarray(np.radians(np.arange(0.0, 360.0, step_deg)))
    steps = int(np.ceil(widest_deg / step_deg)) if widest_deg > 0 else 0
    return np.asarray(np.radians(np.linspace(-widest_deg, widest_deg, 2 * steps + 1)))
