"""Bodies: the stiff parts of a vehicle that bends at its joints."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Body"]


@dataclass(frozen=True)
class Body:
    """One stiff part of a vehicle that bends.

    Attributes:
        asset: name of its mesh.
        middle_m: how far its middle lies behind the vehicle's nose when it is straight, metres.
        guides_m: two places on its long axis that the way decides, as distances behind the
            vehicle's nose when it is straight, metres: on rails the middles of bogies or joints
            over them, on roads the joint to what pulls it (of the first body its front axle) and
            its rear axle.
    """

    asset: str
    middle_m: float
    guides_m: tuple[float, float]
