"""What becomes of a node's frames on the air: when each arrives, and which are lost."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.fleet.draws import Purpose, uniform_draws
from urbantwin.site.nodes import RadioSpec

__all__ = ["Received", "received"]

#: No frame is later than this many standard deviations.
_FARTHEST_JITTER = 4.0


class Received(NamedTuple):
    """What became of F frames.

    Attributes:
        lost: (F,) which never arrive.
        arrival_s: (F,) when each arrives, or would have.
    """

    lost: NDArray[np.bool_]
    arrival_s: NDArray[np.float64]


def received(
    spec: RadioSpec, seed: int, numbers: Sequence[int], sent_s: NDArray[np.float64]
) -> Received:
    """Return what becomes of the frames of a node.

    Args:
        spec: of its radio.
        seed: of the node.
        numbers: of the frames, from 0.
        sent_s: (F,) when each is sent, true time of the motion.
    """
    from scipy.special import ndtri

    index = np.asarray(numbers, np.int64)
    draws = uniform_draws(seed, Purpose.RADIO, int(index.max(initial=-1)) + 1)[index]
    lost = draws[:, 0] < spec.loss
    for one in spec.outages:
        until = np.inf if one.stop_s is None else one.stop_s
        lost |= (sent_s >= one.start_s) & (sent_s < until)
    late = np.clip(ndtri(draws[:, 1]), -_FARTHEST_JITTER, _FARTHEST_JITTER) * spec.jitter_s
    return Received(lost, sent_s + np.maximum(spec.latency_s + late, 0.0))
