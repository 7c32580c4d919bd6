"""A CARLA package before the rules of CARLA 0.9.16's own code, as far as that goes without it."""

from urbantwin.exports.carla.check.finding import Finding
from urbantwin.exports.carla.check.rules import NOT_PROVEN, check_package

__all__ = ["NOT_PROVEN", "Finding", "check_package"]
