"""The twin folder: building it from a site, and opening it."""

from urbantwin.twin.build import build_twin
from urbantwin.twin.twin import GROUND_CLASSES, Twin, load_twin

__all__ = ["GROUND_CLASSES", "Twin", "build_twin", "load_twin"]
