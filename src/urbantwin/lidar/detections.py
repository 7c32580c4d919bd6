"""Detections: the echoes that a sensor reports in a turn, with their measured ranges.

Boxes are the tight bounds of the posed mesh (`compiled.boxes`), pitch and roll included. A labelled
point is inside its box to within 2 cm by construction. Range noise moves a point along its ray and
could carry it out of a box that touches the mesh, whereas an annotator draws a box around the
points. So the noise of a return from an actor is drawn from the normal distribution truncated to
the ray's interval in the actor's box, enlarged by `BOX_MARGIN_M` (less the quantisation of the
range). Points keep the label of the surface that they hit: background that noise moves into a box
stays background.
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

#: Largest distance of a labelled point outside its box, metres.
BOX_MARGIN_M = 0.019


class Detections(NamedTuple):
    """M returns of a sensor, in the order of their beams.

    Attributes:
        beam: (M,) int32.
        echo: (M,) uint8, number of the return within its beam.
        semantic: (M,) uint16, class of the static surface; undefined where an actor was hit.
        range_m: (M,) float32, measured range.
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
        """Return uninitialised arrays for a number of detections."""
        return cls(
            np.empty(count, np.int32),
            np.empty(count, np.uint8),
            np.empty(count, np.uint16),
            np.empty(count, np.float32),
            np.empty(count, np.float32),
            np.empty(count, np.int32),
        )


class Touching(NamedTuple):
    """The K detections in beams that touch actors.

    Attributes:
        row: (K,) int32, index of the detection.
        sigma: (K,) float32, standard deviation of its range, metres.
        amplitude: (K,) float32, of its echo.
    """

    row: NDArray[np.int32]
    sigma: NDArray[np.float32]
    amplitude: NDArray[np.float32]


class Slots(NamedTuple):
    """Positions of A spurious echoes among the detections, at most one per beam.

    Attributes:
        beam: (A,) int32, ascending.
        row: (A,) int32, index of the first detection of that beam.
        had: (A,) uint8, number of its other detections. If the sensor can report one more, the row
            after them is reserved: only its beam is set.
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
    """Return the echoes that are detected; ranges on actors are still without noise.

    Args:
        view: responses to the static world.
        echoes: echoes in beams that touch actors.
        draws: random draws of the turn.
        model: return model of the sensor.
        added: (A,) beams with spurious echoes, ascending.
        dual: whether the sensor reports two returns per beam.
    """
    most = 2 if dual else 1
    out = Detections.room(most * len(echoes.place))
    room = most * len(echoes.beam)
    touching = Touching(
        np.empty(room, np.int32), np.empty(room, np.float32), np.empty(room, np.float32)
    )
    slots = Slots(added, np.empty(len(added), np.int32), np.empty(len(added), np.uint8))
    layer_class = view.layers.semantic
    count, touch_count = detect(
        view.answers, echoes, layer_class, draws, model.step_m, dual, out, touching, slots
    )
    return (
        Detections._make(values[:count] for values in out),
        Touching._make(values[:touch_count] for values in touching),
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
    """Add noise and quantisation to ranges on actors, within the actors' boxes.

    A ray is moved along with its actor to the time of the actor's box. A return whose ray misses
    the upright box of a tilted actor is assigned to no actor.

    Args:
        detections: detections as of `detected`; changed in place.
        touching: detections in beams that touch actors.
        draws: random draws of the turn.
        view: the static world as the sensor sees it.
        firing: beams of the turn.
        actors: actors of the frame.
        standing: actors at the times of their boxes.
        model: return model of the sensor.
    """
    step_m, aside = float(model.step_m), view.beams.aside
    thin = len(firing.footprint) == 1
    if thin and not step_m and not aside and model.response.sigma_m == 0:
        return  # exact points lie on the mesh, inside the box
    # Quantisation adds up to half a step of range and of azimuth.
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
    # The mean of several surfaces may be outside: clip it first.
    at = np.clip(detections.range_m[row], np.minimum(low, high), high)
    wide = np.maximum(sigma.astype(np.float64), 1e-9)
    beam = detections.beam[row]
    noise = np.where(detections.echo[row] == 0, draws.first.noise[beam], draws.second.noise[beam])
    noise_inside = truncated_noise(
        noise, np.minimum((low - at) / wide, 0), np.maximum((high - at) / wide, 0)
    )
    inside = np.where(sigma > 0, at + wide * noise_inside, at).astype(np.float32)
    detections.range_m[row] = model.quantised(inside)
    beside = row[low > high]
    detections.actor[beside], detections.semantic[beside] = -1, OUTLIER
