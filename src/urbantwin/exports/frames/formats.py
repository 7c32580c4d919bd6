"""Export formats of datasets."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType

from urbantwin.dataset.reading import Fleet
from urbantwin.exports.frames.losses import FIELDS
from urbantwin.exports.frames.source import FrameSource
from urbantwin.progress import Progress

__all__ = ["DATASET_FORMATS", "DatasetFormat", "Writer"]

#: Writes a dataset, given the folder or file to write into and a progress callback; returns notes
#: for the user.
Writer = Callable[[FrameSource, Path, Progress], Sequence[str]]
#: Writes datasets of the same frames, one per sensor of a rig.
PartsWriter = Callable[[Sequence[FrameSource], Path, Progress], Sequence[str]]
#: The same for a fleet.
FleetWriter = Callable[[Fleet, Path, Progress], Sequence[str]]


@dataclass(frozen=True)
class DatasetFormat:
    """An export format.

    Attributes:
        name: name for ``--to``.
        title: title for display.
        holds: the ``losses.FIELDS`` that it can hold.
        ending: suffix of the file's name; empty for a folder.
        module: module of its writer ``write_NAME``.
    """

    name: str
    title: str
    holds: frozenset[str]
    ending: str
    module: str

    @property
    def write(self) -> Writer:
        """Its writer; importing it imports the library that it needs."""
        writer: Writer = getattr(self._module(), f"write_{self.name}")
        return writer

    @property
    def write_parts(self) -> PartsWriter | None:
        """Writer of one dataset per sensor, ``write_NAME_parts``; ``None`` if not supported."""
        writer: PartsWriter | None = getattr(self._module(), f"write_{self.name}_parts", None)
        return writer

    @property
    def write_fleet(self) -> FleetWriter | None:
        """Writer of fleets, ``write_NAME_fleet``; ``None`` if not supported."""
        writer: FleetWriter | None = getattr(self._module(), f"write_{self.name}_fleet", None)
        return writer

    def losses_besides(self, source: FrameSource) -> list[str]:
        """Return further losses, from ``losses_NAME`` in its module, if any.

        Raises:
            InputError: the format cannot hold this dataset at all.
        """
        losses = getattr(self._module(), f"losses_{self.name}", None)
        return [] if losses is None else list(losses(source))

    def _module(self) -> ModuleType:
        return import_module(f"urbantwin.exports.frames.{self.module}")


def _format(name: str, title: str, holds: str, ending: str = "", writer: str = "") -> DatasetFormat:
    return DatasetFormat(name, title, frozenset(holds.split()), ending, writer or name)


_OF_POINTS = " ".join(name for name, (of, _) in FIELDS.items() if of == "points")
#: Content of ``boxes.csv`` and ``frames.csv`` beside clouds.
_LISTED = " ".join(name for name, (of, _) in FIELDS.items() if of != "points")

DATASET_FORMATS: Mapping[str, DatasetFormat] = {
    one.name: one
    for one in (
        _format("openpcdet", "OpenPCDet's custom dataset", "intensity boxes split"),
        _format(
            "mmdet3d",
            "MMDetection3D's custom dataset",
            "intensity boxes track velocity num_points frame_time split",
        ),
        _format("kitti", "KITTI's object benchmark", "intensity boxes occlusion truncation split"),
        _format(
            "nuscenes",
            "nuScenes",
            "intensity ring semantic instance boxes track num_points parked frame_time frame_pose "
            "sensor_poses split",
        ),
        _format(
            "semantickitti",
            "SemanticKITTI",
            "intensity semantic instance frame_time frame_pose split",
        ),
        _format("openlabel", "ASAM OpenLABEL beside clouds", " ".join(FIELDS)),
        _format("opv2v", "OPV2V", "intensity sensor boxes track frame_time frame_pose split"),
        _format(
            "lumpi",
            "LUMPI",
            "intensity ring time sensor boxes track num_points frame_time sensor_poses split",
        ),
        _format("pcd", "PCD files, boxes in a list", f"{_OF_POINTS} {_LISTED}"),
        _format("las", "LAS files, boxes in a list", f"{_OF_POINTS} {_LISTED}"),
        _format("laz", "LAZ files, boxes in a list", f"{_OF_POINTS} {_LISTED}", writer="las"),
        _format("mcap", "MCAP", " ".join(FIELDS), ".mcap"),
        _format("webdataset", "WebDataset", " ".join(FIELDS)),
        _format("parquet", "Parquet, a row for each frame", " ".join(FIELDS)),
    )
}
