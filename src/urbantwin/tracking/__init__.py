"""Who is who in detections of frame after frame: Kalman filters and assignment."""

from urbantwin.tracking.linking import Linking
from urbantwin.tracking.tracker import tracked

__all__ = ["Linking", "tracked"]
