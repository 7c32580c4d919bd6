"""A second look: the single points about what a detector found, and how likely it is then.

Cells from above merge who stands up with whatever else does. Two-stage detectors (Shi, Wang and Li
2019, "PointRCNN") look again at the points of each proposal; this one says anew how likely it is.
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
