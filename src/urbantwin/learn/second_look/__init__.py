"""The second stage: rescores detections of pedestrians and two-wheelers from their points.

In bird's-eye-view cells a person looks like any other upright object. Like two-stage detectors
(Shi, Wang and Li 2019, "PointRCNN"), this stage reads the points around each detection; it changes
the score alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.learn.second_look.crop import LOOKED_AT, Crops, crops_of
    from urbantwin.learn.second_look.network import SecondLook
    from urbantwin.learn.second_look.scoring import looked_again
    from urbantwin.learn.second_look.training import second_look_trained

__all__ = [
    "LOOKED_AT",
    "Crops",
    "SecondLook",
    "crops_of",
    "looked_again",
    "second_look_trained",
]

names_on_demand(__name__)
