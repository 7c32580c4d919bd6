"""Readers of datasets and fleets; the only code that opens their files."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.dataset.reading.dataset import Dataset
    from urbantwin.dataset.reading.datasets import Datasets
    from urbantwin.dataset.reading.fleet import Fleet, FleetFrame, NodeFrame, NodeState
    from urbantwin.dataset.reading.frame import Frame
    from urbantwin.dataset.reading.frame_files import FrameFiles
    from urbantwin.dataset.reading.fused import FusedCloud, fused_cloud
    from urbantwin.dataset.reading.manifest import pose_of_matrix, read_manifest
    from urbantwin.dataset.reading.selection import Frames, Selection

__all__ = [
    "Dataset",
    "Datasets",
    "Fleet",
    "FleetFrame",
    "Frame",
    "FrameFiles",
    "Frames",
    "FusedCloud",
    "NodeFrame",
    "NodeState",
    "Selection",
    "fused_cloud",
    "pose_of_matrix",
    "read_manifest",
]

names_on_demand(__name__)
