"""UrbanTwin fleets for the page: times, sensors of nodes, additional columns of labels."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.dataset.reading import Fleet
from urbantwin.dataset.reading.manifest import read_manifest
from urbantwin.fidelity.readers import Recording
from urbantwin.geometry import Pose
from urbantwin.web.own_dataset import OwnDataset
from urbantwin.web.side import FrameEntry

__all__ = ["OwnFleet"]


class OwnFleet(OwnDataset):
    """A fleet's tables and manifests, presented as one dataset in the site frame.

    Args:
        folder: folder of the fleet.

    Raises:
        InputError: a manifest is wrong.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._files = Fleet(folder)
        self._of_nodes = {
            name: read_manifest(self._files.folder_of(name)) for name in self._files.node_names
        }
        first = next(iter(self._of_nodes.values()))
        self.manifest: dict[str, Any] = {
            **self._files.manifest,
            "made_from": first.get("made_from"),
        }

    @property
    def rate_hz(self) -> float:
        """Frames per second of all nodes."""
        return float(self.manifest["rate_hz"])

    @cached_property
    def sensors(self) -> list[dict[str, Any]]:
        """Sensors of static nodes; those of mobile nodes are at the origin of their points."""
        return [
            {**one, "name": f"{node} {one['name']}"}
            for node, manifest in self._of_nodes.items()
            for one in manifest["rig"]["sensors"]
            if one.get("carrier_SE3_sensor") is None
        ]

    def entries(self, recording: Recording) -> list[FrameEntry]:
        """Return the frames with the point counts of all nodes."""
        table = self._files.states
        count = dict.fromkeys(recording.names, 0)
        rows = zip(table["frame"].to_pylist(), table["points"].to_pylist(), strict=True)
        for name, points in rows:
            count[name] = count.get(name, 0) + int(points)
        times = self._files.times_s.tolist()
        return [
            FrameEntry(name, time_s, count[name])
            for name, time_s in zip(recording.names, times, strict=True)
        ]

    def site_SE3_frame(self, name: str) -> Pose | None:  # noqa: N802
        """Return that its points are in the site."""
        return Pose.from_ypr(np.zeros(3))
