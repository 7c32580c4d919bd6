"""Detectors: trained, run, tracked, judged and improved."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.interface.detected_objects import DetectedObjects, detect
    from urbantwin.interface.evaluation_report import Evaluation, evaluate
    from urbantwin.interface.fusion_study import FusionStudy, fuse
    from urbantwin.interface.improvement import Improved, improve
    from urbantwin.interface.labelled_recording import LabelledRecording, label
    from urbantwin.interface.teaching import Taught, teach
    from urbantwin.interface.tracked_objects import TrackedObjects, track
    from urbantwin.interface.trained_model import TrainedModel, pretrain, train

__all__ = [
    "DetectedObjects",
    "Evaluation",
    "FusionStudy",
    "Improved",
    "LabelledRecording",
    "Taught",
    "TrackedObjects",
    "TrainedModel",
    "detect",
    "evaluate",
    "fuse",
    "improve",
    "label",
    "pretrain",
    "teach",
    "track",
    "train",
]

names_on_demand(__name__)
