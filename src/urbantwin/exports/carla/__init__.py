"""A twin as a package of maps for CARLA 0.9.16, and the same rig on a live server."""

from urbantwin.exports.carla.package import write_carla

__all__ = ["write_carla"]
