"""A data set that is written in another format: single, and checked before anything is written."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.dataset.reading import Dataset
from urbantwin.dataset.reading.objects import LabelledObjects
from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.taxonomy import BOX_SEMANTICS

__all__ = ["FrameSource"]


class FrameSource(Dataset):
    """A data set, opened to be written in another format.

    Raises:
        InputError: it is no data set, or a folder with a data set for each sensor.
    """

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        if self.manifest["kind"] != "dataset":
            raise InputError(
                "holds a dataset for each sensor",
                file=folder,
                expected=f"one of them: {', '.join(self.manifest['datasets'])}",
            )

    @cached_property
    def sensors(self) -> tuple[Mapping[str, Any], ...]:
        """The sensors' entries in the manifest, in the order of ``rays["sensor"]``."""
        return tuple(self.manifest["rig"]["sensors"])

    @property
    def site(self) -> SiteFrame:
        """The site's frame of reference, with its origin on the Earth."""
        anchor = self.manifest["anchor"]
        return SiteFrame(float(anchor["latitude"]), float(anchor["longitude"]))

    @property
    def rate_hz(self) -> float:
        """Frames a second of the rig."""
        return float(self.manifest["rig"]["rate_hz"])

    def part_of(self, name: str) -> str | None:
        """Return a frame's part of the split; ``None`` without one."""
        return self._part_of_frame.get(name)

    @cached_property
    def _part_of_frame(self) -> dict[str, str]:
        return {name: part for part, names in self.splits.items() for name in names}

    @cached_property
    def labelled_classes(self) -> tuple[str, ...]:
        """Classes with a box."""
        counts = self.manifest["counts"]["boxes"]
        return tuple(name for name, count in counts.items() if count)

    @cached_property
    def objects(self) -> LabelledObjects:
        """The labelled boxes.

        Raises:
            InputError: an actor has an unknown class, or two boxes in a frame.
        """
        found = super().objects
        unknown = next((one for one in found.class_name if one not in BOX_SEMANTICS), None)
        if unknown is not None:
            raise InputError(
                f"has the class {str(unknown)[:40]!r}",
                file=found.file,
                place="class",
                expected=", ".join(BOX_SEMANTICS),
            )
        order = np.lexsort((found.track, found.frame.astype(str)))
        frame, track = found.frame[order], found.track[order]
        twice = np.flatnonzero((frame[1:] == frame[:-1]) & (track[1:] == track[:-1]))
        if len(twice):
            raise InputError(
                f"has the track {track[twice[0]]} twice in frame {frame[twice[0]][:40]}",
                file=found.file,
                place="track",
                expected="one box of each actor in a frame",
            )
        return found
