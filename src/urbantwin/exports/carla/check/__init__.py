"""A CARLA package before the rules of CARLA 0.9.16's own code, as far as that goes without it."""

from urbantwin.exports.carla.check.finding import Finding
from urbantwin.exports.carla.check.rules import check_package

__all__ = ["Finding", "check_package"]
