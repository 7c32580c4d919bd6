"""Datasets: recording frames with workers and resume; the OpenPCDet and SemanticKITTI layouts."""

from urbantwin.dataset.description import describe, parts_of
from urbantwin.dataset.provenance import asked_of
from urbantwin.dataset.recording import record
from urbantwin.dataset.split import split_frames

__all__ = ["asked_of", "describe", "parts_of", "record", "split_frames"]
