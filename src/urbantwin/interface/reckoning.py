"""How long long commands take, as spans: what two processors of a laptop need."""

from __future__ import annotations

__all__ = [
    "FRAME_S",
    "JUDGED_S",
    "STEP_S",
    "TRAFFIC_S",
    "TWIN_S",
    "training_s",
]

#: Seconds at least and at most for a twin; for a second of traffic; for a frame of one sensor; for
#: the judgement of one; for a step of training with its share of the second look.
TWIN_S, TRAFFIC_S, FRAME_S, JUDGED_S = (15.0, 200.0), (0.12, 1.2), (0.1, 0.8), (0.3, 1.5)
STEP_S = (0.13, 0.7)
#: Reading of datasets and what else training takes beside its minutes.
_AROUND_TRAINING = (1.05, 1.4)


def training_s(minutes: float, steps: int | None) -> tuple[float, float]:
    """Return the least and the most seconds of training with what is around it."""
    low, high = (60 * minutes if steps is None else steps * one for one in STEP_S)
    return low * _AROUND_TRAINING[0], high * _AROUND_TRAINING[1]
