"""Detections: which echoes a sensor reports in a turn, at which ranges.

Boxes are the tight bounds of the posed mesh (`compiled.boxes`), so pitch and roll are inside them.
A labelled point lies inside its box by construction, to 2 cm. Range noise moves a point along its
ray, and would carry some out of a box that touches the mesh; an annotator draws a box around what
the sensor saw. So the noise of a return from an actor is drawn from the normal distribution
truncated to where the ray runs inside the actor's box, grown by `BOX_MARGIN_M` (less what the
range's quantisation can add). Points keep the label of what their ray hit: background that noise
carries into a box stays background.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.casting.tracer import Firing
from urbantwin.lidar.compiled.carried import leaving
from urbantwin.lidar.compiled.report import OUTLIER, detect
from urbantwin.lidar.echoes import Echoes
from urbantwin.lidar.returns import ReturnModel, standard_noise, truncated_noise
from urbantwin.lidar.returns.draws import TurnDraws
from urbantwin.lidar.shapes import PresentActors
from urbantwin.lidar.standing import Standing
from urbantwin.lidar.static_view import StaticView

__all__ = ["BOX_MARGIN_M", "Detections", "detected", "spans_in_box", "within_boxes"]

#: No labelled point lies farther outside its box.
BOX_MARGIN_M = 0.019


class Detections(NamedTuple):
    """M returns of a sensor in the order of their beams.

    Attributes:
        beam: (M,) int32.
        echo: (M,) uint8, number among those of its beam.
        source: (M,) int32, number of the echo; -1 for what the static world alone sends back.
        semantic: (M,) uint16, class of the static surface; meaningless where an actor was hit.
        range_m: (M,) float32, as measured.
        intensity: (M,) float32.
        actor: (M,) int32, -1 for none.
    """

    beam: NDArray[np.int32]
    echo: NDArray[np.uint8]
    source: NDArray[np.int32]
    semantic: NDArray[np.uint16]
    range_m: NDArray[np.float32]
    intensity: NDArray[np.float32]
    actor: NDArray[np.int32]

    @classmethod
    def room(cls, count: int) -> Detections:
        """Return room for so many detections to be written."""
        return cls(
            np.empty(count, np.int32),
            np.empty(count, np.uint8),
            np.empty(count, np.int32),
            np.empty(count, np.uint16),
            np.empty(count, np.float32),
            np.empty(count, np.float32),
            np.empty(count, np.int32),
        )


def detected(
    view: StaticView, echoes: Echoes, draws: TurnDraws, model: ReturnModel, *, dual: bool
) -> Detections:
    """Return which echoes the draws make detections; ranges of actors are without their noise.

    Args:
        view: what the sensor would report of the static world.
        echoes: along the beams that touch actors.
        draws: of the turn.
        model: what the sensor makes of echoes.
        dual: whether it reports two echoes of a beam.
    """
    count = len(echoes.place)
    out = Detections.room(2 * count if dual else count)
    found = detect(view.answers, echoes, view.layers.semantic, draws, model.step_m, dual, out)
    return Detections._make(values[:found] for values in out)


def within_boxes(
    detections: Detections,
    echoes: Echoes,
    draws: TurnDraws,
    view: StaticView,
    firing: Firing,
    actors: PresentActors,
    standing: Standing,
    model: ReturnModel,
) -> Detections:
    """Return detections with the ranges of actors noisy, quantised and inside their boxes.

    A beam is carried along with its actor to where that stands in its box. Beams that pass beside
    the box all the same (it stands upright, the actor may not) belong to no actor.

    Args:
        detections: as `detected`.
        echoes: along the beams that touch actors.
        draws: of the turn.
        view: the static world as the sensor sees it.
        firing: the beams of the turn.
        actors: everything that moves.
        standing: where the actors stand in their boxes.
        model: what the sensor makes of echoes.
    """
    hit = np.flatnonzero(detections.actor >= 0)
    beam, actor = detections.beam[hit], detections.actor[hit]
    source = detections.source[hit]
    range_m, sigma = echoes.range_m[source], echoes.sigma[source]
    noise = np.where(detections.echo[hit] == 0, draws.first.noise[beam], draws.second.noise[beam])
    step_m, aside = float(model.step_m), view.beams.aside
    thin = len(firing.footprint) == 1
    if thin and not step_m and not aside and model.response.sigma_m == 0:
        detections.range_m[hit] = range_m  # On the mesh, which the box holds.
        return detections
    measured = range_m + sigma * standard_noise(noise)
    # Half a step of the range may come on top, and half a step of the azimuth.
    margin = max(0.0, BOX_MARGIN_M - step_m / 2 - aside * float(range_m.max(initial=0.0)))
    leaves, origin, aim = leaving(beam, actor, measured, actors.paths, firing, standing, margin)
    if len(leaves):
        own = standing.boxes.T.take(actor[leaves], axis=1)
        low, high = spans_in_box(origin, aim, own, margin)
        # What several surfaces give together may lie between them: it is brought inside first.
        at = np.clip(range_m[leaves], np.minimum(low, high), high)
        wide = np.maximum(sigma[leaves].astype(np.float64), 1e-9)
        kept = truncated_noise(
            noise[leaves],
            np.minimum((low - at) / wide, 0),
            np.maximum((high - at) / wide, 0),
        )
        measured[leaves] = np.where(sigma[leaves] > 0, at + wide * kept, at)
        beside = hit[leaves[low > high]]
        detections.actor[beside], detections.semantic[beside] = -1, OUTLIER
    detections.range_m[hit] = model.quantised(measured)
    return detections


def spans_in_box(
    origin: NDArray[np.float64],
    directions: NDArray[np.float64],
    boxes: NDArray[np.float64],
    margin: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where rays enter and leave their own boxes grown by ``margin``, metres.

    Args:
        origin: (3, M) where the rays leave.
        directions: (3, M) unit vectors.
        boxes: (7, M) a box for each ray.
        margin: metres.
    """
    start = _turned(origin - boxes[:3], boxes[6])
    along = _turned(directions, boxes[6])
    half = boxes[3:6] / 2 + margin
    # A ray along a face never meets the other two of its kind: infinitely far is right there.
    along[along == 0] = 1e-300
    one, other = (-half - start) / along, (half - start) / along
    return np.minimum(one, other).max(axis=0), np.maximum(one, other).min(axis=0)


def _turned(vectors: NDArray[np.floating], yaw: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return vectors (3, M) in frames turned by yaw (M,)."""
    c, s = np.cos(yaw), np.sin(yaw)
    x, y, z = vectors
    return np.stack([x * c + y * s, y * c - x * s, z])
