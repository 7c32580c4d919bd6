"""A dataset's frames and labels in other formats."""

from urbantwin.exports.frames.formats import DATASET_FORMATS, DatasetFormat
from urbantwin.exports.frames.losses import losses_of
from urbantwin.exports.frames.source import FrameSource
from urbantwin.exports.frames.write import export_dataset

__all__ = [
    "DATASET_FORMATS",
    "DatasetFormat",
    "FrameSource",
    "export_dataset",
    "losses_of",
]
