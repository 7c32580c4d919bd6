"""The points of a frame by the names of their fields."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError

if TYPE_CHECKING:
    from urbantwin.interface.dataset import Dataset

__all__ = ["PointFields"]

_PLACE = ("x", "y", "z", "intensity")


class PointFields:
    """What a frame says of its points, field by field; each is read when it is first asked for."""

    dataset: Dataset
    name: str

    if TYPE_CHECKING:  # what who has these fields brings

        @property
        def points(self) -> NDArray[np.float32]: ...  # noqa: D102

        @property
        def semantic(self) -> NDArray[np.uint16]: ...  # noqa: D102

        @property
        def instance(self) -> NDArray[np.uint16]: ...  # noqa: D102

        @property
        def rays(self) -> NDArray[np.void]: ...  # noqa: D102

    @property
    def x(self) -> NDArray[np.float32]:
        """X (N,) of each point, metres."""
        return self.points[:, 0]

    @property
    def y(self) -> NDArray[np.float32]:
        """Y (N,) of each point, metres."""
        return self.points[:, 1]

    @property
    def z(self) -> NDArray[np.float32]:
        """Z (N,) of each point, metres."""
        return self.points[:, 2]

    @property
    def intensity(self) -> NDArray[np.float32]:
        """Intensity (N,) of each point, 0..1."""
        return self.points[:, 3]

    @property
    def sensor(self) -> NDArray[np.uint8]:
        """Number (N,) of the sensor in the rig that saw each point."""
        return self._of_rays("sensor")

    @property
    def ring(self) -> NDArray[np.uint16]:
        """Channel (N,) of each point, as the maker numbers them."""
        return self._of_rays("ring")

    @property
    def column(self) -> NDArray[np.uint16]:
        """Firing (N,) within the turn of each point."""
        return self._of_rays("column")

    @property
    def time(self) -> NDArray[np.float32]:
        """When each point (N,) was measured by its sensor's clock, seconds from the frame's."""
        return self._of_rays("time")

    @property
    def echo(self) -> NDArray[np.uint8]:
        """Which echo (N,) of its beam each point is: 0, the first that is reported, or 1."""
        return self._of_rays("echo")

    @cached_property
    def cloud(self) -> NDArray[np.void]:
        """All of it (N,) as one structured array: ``cloud["ring"]``, ``cloud[cloud["x"] > 3]``.

        Its fields are ``x``, ``y``, ``z``, ``intensity``, those of the rays (``sensor``, ``ring``,
        ``column``, ``time``, ``echo``; datasets of older versions lack some), ``semantic`` and
        ``instance``.
        """
        rays = self.rays
        kinds: list[tuple[str, Any]] = [(name, "<f4") for name in _PLACE]
        kinds += [(name, rays.dtype[name]) for name in rays.dtype.names or ()]
        kinds += [("semantic", "<u2"), ("instance", "<u2")]
        cloud = np.empty(len(self.points), kinds)
        for axis, name in enumerate(_PLACE):
            cloud[name] = self.points[:, axis]
        for name in rays.dtype.names or ():
            cloud[name] = rays[name]
        cloud["semantic"], cloud["instance"] = self.semantic, self.instance
        return cloud

    def _of_rays(self, name: str) -> NDArray[Any]:
        if name not in (self.rays.dtype.names or ()):
            raise InputError(
                f"does not say the {name} of its points",
                file=Path(self.dataset) / "rays" / f"{self.name}.npy",
                expected="rays as they are recorded now; this dataset is of an older version",
            )
        return self.rays[name]
