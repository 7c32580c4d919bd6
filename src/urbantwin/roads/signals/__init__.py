"""Traffic signals and signs: signalised junctions, signal programs, heads and poles."""

from urbantwin.roads.signals.country_practice import meaning_of, plate_of, practice_of
from urbantwin.roads.signals.pose import Head, heads_of, pose_of

__all__ = ["Head", "heads_of", "meaning_of", "plate_of", "pose_of", "practice_of"]
