"""Returns: from what a ray hits to what a sensor reports.

`scatter` says what surfaces send back; `detection`, `noise`, `sunlight`, `air` and `intensity` what
the sensor makes of it, put together by `model` (in compiled code: `compiled.response`); `draws`
holds the random numbers. Strength is what all of it follows from: signal to noise, 1 of a target of
the datasheet's reflectivity, faced squarely, at the datasheet's range.
"""

from urbantwin.lidar.returns.draws import (
    LEVELS,
    Draws,
    Purpose,
    TurnDraws,
    draw,
    standard_noise,
    standard_quantiles,
    truncated_noise,
)
from urbantwin.lidar.returns.model import ReturnModel
from urbantwin.lidar.returns.scatter import Scatter, scatter_of_materials

__all__ = [
    "LEVELS",
    "Draws",
    "Purpose",
    "ReturnModel",
    "Scatter",
    "TurnDraws",
    "draw",
    "scatter_of_materials",
    "standard_noise",
    "standard_quantiles",
    "truncated_noise",
]
