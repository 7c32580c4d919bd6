"""Export of a twin as a CARLA 0.9.16 map package, and its rig on a live server."""

from urbantwin.exports.carla.package import write_carla

__all__ = ["write_carla"]
