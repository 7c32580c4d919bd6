"""LiDAR detectors: pillars, the network, its training and inference.

Needs torch, so names are imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.learn.detecting import detected
    from urbantwin.learn.from_labels import trained
    from urbantwin.learn.labelled_frames import (
        LabelledFrames,
        labelled_frames,
        unlabelled_frames,
    )
    from urbantwin.learn.model import SHIPPED_MODEL, Design, Model, read_model, write_model
    from urbantwin.learn.pretraining import pretrained
    from urbantwin.learn.training import Recipe

__all__ = [
    "SHIPPED_MODEL",
    "Design",
    "LabelledFrames",
    "Model",
    "Recipe",
    "detected",
    "labelled_frames",
    "pretrained",
    "read_model",
    "trained",
    "unlabelled_frames",
    "write_model",
]

names_on_demand(__name__)
