"""Usual objects beside streets that are not mapped: plot boundaries, shrubs, furniture."""

from urbantwin.scene.clutter.assumed import Assumed, assumed_features

__all__ = ["Assumed", "assumed_features"]
