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
from urbantwin.lidar.compiled.carried import keep_inside
from urbantwin.lidar.compiled.report import OUTLIER, detect
from urbantwin.lidar.echoes import Echoes
from urbantwin.lidar.returns import ReturnModel, truncated_noise
from urbantwin.lidar.returns.draws import TurnDraws
from urbantwin.lidar.shapes import PresentActors
from urbantwin.lidar.standing import Standing
from urbantwin.lidar.static_view import StaticView

__all__ = [
    "BOX_MARGIN_M",
    "Detections",
    "Slots",
    "Touching",
    "detected",
    "within_boxes",
]

#: No labelled point lies farther outside its box.
BOX_MARGIN_M = 0.019


class Detections(NamedTuple):
    """M returns of a sensor in the order of their beams.

    Attributes:
        beam: (M,) int32.
        echo: (M,) uint8, number among those of its beam.
        semantic: (M,) uint16, class of the static surface; meaningless where an actor was hit.
        range_m: (M,) float32, as measured.
        intensity: (M,) float32.
        actor: (M,) int32, -1 for none.
    """

    beam: NDArray[np.int32]
    echo: NDArray[np.uint8]
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
            np.empty(count, np.uint16),
            np.empty(count, np.float32),
            np.empty(count, np.float32),
            np.empty(count, np.int32),
        )


class Touching(NamedTuple):
    """Which K detections are of beams that touch actors.

    Attributes:
        row: (K,) int32, number of the detection.
        sigma: (K,) float32, standard deviation of its range, metres.
        amplitude: (K,) float32, of its echo.
    """

    row: NDArray[np.int32]
    sigma: NDArray[np.float32]
    amplitude: NDArray[np.float32]


class Slots(NamedTuple):
    """Where A spurious echoes may go, at most one of a beam.

    Attributes:
        beam: (A,) int32, ascending.
        row: (A,) int32, number of the first detection of that beam.
        had: (A,) uint8, how many it has without the spurious one. Where the sensor reports more,
            the row after them is left out but for its beam.
    """

    beam: NDArray[np.int32]
    row: NDArray[np.int32]
    had: NDArray[np.uint8]


def detected(
    view: StaticView,
    echoes: Echoes,
    draws: TurnDraws,
    model: ReturnModel,
    added: NDArray[np.int32],
    *,
    dual: bool,
) -> tuple[Detections, Touching, Slots]:
    """Return which echoes the draws make detections; ranges of actors are without their noise.

    Args:
        view: what the sensor would report of the static world.
        echoes: along the beams that touch actors.
        draws: of the turn.
        model: what the sensor makes of echoes.
        added: (A,) beams with spurious echoes, ascending.
        dual: whether it reports two echoes of a beam.
    """
    most = 2 if dual else 1
    out = Detections.room(most * len(echoes.place))
    room = most * len(echoes.beam)
    touching = Touching(
        np.empty(room, np.int32), np.empty(room, np.float32), np.empty(room, np.float32)
    )
    slots = Slots(added, np.empty(len(added), np.int32), np.empty(len(added), np.uint8))
    layer_class = view.layers.semantic
    found, touch = detect(
        view.answers, echoes, layer_class, draws, model.step_m, dual, out, touching, slots
    )
    return (
        Detections._make(values[:found] for values in out),
        Touching._make(values[:touch] for values in touching),
        slots,
    )


def within_boxes(
    detections: Detections,
    touching: Touching,
    draws: TurnDraws,
    view: StaticView,
    firing: Firing,
    actors: PresentActors,
    standing: Standing,
    model: ReturnModel,
) -> None:
    """Make the ranges of detections of actors noisy, quantised and inside their boxes.

    A beam is carried along with its actor to where that stands in its box. Beams that pass beside
    the box all the same (it stands upright, the actor may not) belong to no actor.

    Args:
        detections: as `detected`; to be written.
        touching: which of them are of beams that touch actors.
        draws: of the turn.
        view: the static world as the sensor sees it.
        firing: the beams of the turn.
        actors: everything that moves.
        standing: where the actors stand in their boxes.
        model: what the sensor makes of echoes.
    """
    step_m, aside = float(model.step_m), view.beams.aside
    thin = len(firing.footprint) == 1
    if thin and not step_m and not aside and model.response.sigma_m == 0:
        return  # On the mesh, which the box holds.
    # Half a step of the range may come on top, and half a step of the azimuth.
    far = 0.0
    if aside:
        row = touching.row[detections.actor[touching.row] >= 0]
        far = float(detections.range_m[row].max(initial=0.0))
    margin = max(0.0, BOX_MARGIN_M - step_m / 2 - aside * far)
    leaves, low, high = keep_inside(
        detections, touching, draws, model.step_m, actors.paths, firing, standing, margin
    )
    if not len(leaves):
        return
    row, sigma = touching.row[leaves], touching.sigma[leaves]
    # What several surfaces give together may lie between them: it is brought inside first.
    at = np.clip(detections.range_m[row], np.minimum(low, high), high)
    wide = np.maximum(sigma.astype(np.float64), 1e-9)
    beam = detections.beam[row]
    noise = np.where(detections.echo[row] == 0, draws.first.noise[beam], draws.second.noise[beam])
    kept = truncated_noise(
        noise, np.minimum((low - at) / wide, 0), np.maximum((high - at) / wide, 0)
    )
    inside = np.where(sigma > 0, at + wide * kept, at).astype(np.float32)
    detections.range_m[row] = model.quantised(inside)
    beside = row[low > high]
    detections.actor[beside], detections.semantic[beside] = -1, OUTLIER
