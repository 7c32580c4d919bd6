"""Tracking of detections over frames: Kalman filters and assignment."""

from urbantwin.tracking.linking import Linking
from urbantwin.tracking.tracker import tracked

__all__ = ["Linking", "tracked"]
