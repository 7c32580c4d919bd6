"""Labels of one frame, taken from its rays."""

from urbantwin.lidar.labels.difficulty import LEVELS, Level, difficulty_of
from urbantwin.lidar.labels.frame import BoxLabel, LabelledFrame
from urbantwin.lidar.labels.kept_in_box import BOX_MARGIN_M, spans_in_box

__all__ = [
    "BOX_MARGIN_M",
    "LEVELS",
    "BoxLabel",
    "LabelledFrame",
    "Level",
    "difficulty_of",
    "spans_in_box",
]
