"""How many of each class come per hour, where only who is there at a time was counted."""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["per_hour_of_presence"]

#: How fast those move on average within view of a junction, waiting included, m/s. Assumed: whoever
#: is half as fast is there twice as long, so that half as many make as many boxes.
_SPEED_MPS = {"pedestrian": 1.3, "bicycle": 4.0}
_MOTOR_MPS = 6.0
#: Who shares the road as motor traffic.
_MOTOR = ("car", "van", "truck", "bus", "motorcycle")


def per_hour_of_presence(
    boxes_per_frame: Mapping[str, float], guess: Mapping[str, int]
) -> dict[str, int]:
    """Return actors per hour by class: as many motor vehicles as guessed, in the measured shares.

    Args:
        boxes_per_frame: how many of each class are seen at a time.
        guess: per hour, of the map alone; classes that were not measured keep it.
    """
    motor = sum(guess.get(name, 0) for name in _MOTOR)
    seen = sum(boxes_per_frame.get(name, 0.0) for name in _MOTOR)
    if not seen:
        return dict(guess)
    found = {name: count for name, count in guess.items() if name not in boxes_per_frame}
    found = {name: count for name, count in found.items() if name not in _MOTOR}
    for name, boxes in boxes_per_frame.items():
        speed = _SPEED_MPS.get(name, _MOTOR_MPS)
        found[name] = round(motor * boxes / seen * speed / _MOTOR_MPS)
    order = [*guess, *(name for name in found if name not in guess)]
    return {name: found[name] for name in order if name in found}
