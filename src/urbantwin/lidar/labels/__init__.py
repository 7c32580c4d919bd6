"""Labels of one frame, taken from its rays."""

from urbantwin.lidar.labels.difficulty import LEVELS, Level, difficulty_of
from urbantwin.lidar.labels.frame import BoxLabel, LabelledFrame

__all__ = [
    "LEVELS",
    "BoxLabel",
    "LabelledFrame",
    "Level",
    "difficulty_of",
]
