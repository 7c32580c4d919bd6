"""Protocol of the published challenge: realism, detection, and a submission's rules."""

from urbantwin.fidelity.challenge.average_precision import (
    Box,
    average_precision,
    mean_precision,
)
from urbantwin.fidelity.challenge.protocol import (
    CLASSES,
    CROP_M,
    FRAMES,
    NAME,
    Score,
    challenge_class,
    check_protocol,
    combined_score,
    cropped,
    normalised,
)
from urbantwin.fidelity.challenge.scores import (
    MomentFit,
    fit_moments,
    read_detections,
    realism,
    score_clouds,
    score_sides,
)

__all__ = [
    "CLASSES",
    "CROP_M",
    "FRAMES",
    "NAME",
    "Box",
    "MomentFit",
    "Score",
    "average_precision",
    "challenge_class",
    "check_protocol",
    "combined_score",
    "cropped",
    "fit_moments",
    "mean_precision",
    "normalised",
    "read_detections",
    "realism",
    "score_clouds",
    "score_sides",
]
