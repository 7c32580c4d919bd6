"""Returns: from the surface that a ray hits to what a sensor reports.

`scatter` gives the backscatter of surfaces; `sunlight`, `clutter` and `model` the sensor's response
(in compiled code: `compiled.response`); `draws` holds the random numbers. Everything follows from
the strength of an echo: its signal-to-noise ratio relative to a target of the datasheet's
reflectivity, at normal incidence and the datasheet's range.
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
