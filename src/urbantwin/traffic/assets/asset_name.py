"""Names of assets: a body, how it is scaled, and a coat: ``car-hatchback@102-98-101_black``.

The size is in percent of the body's own length, width and height, so that a name means the same
whatever becomes of the catalogue; one number stands for all three, and none for 100.
"""

from __future__ import annotations

import re
from typing import NamedTuple

__all__ = ["AssetName"]

_NAME = re.compile(
    r"(?P<body>[^@_]+)(?:@(?P<x>\d{2,3})(?:-(?P<y>\d{2,3})-(?P<z>\d{2,3}))?)?(?:_(?P<coat>.+))?"
)


class AssetName(NamedTuple):
    """What the name of an asset says.

    Attributes:
        body: name in the catalogue.
        percent: length, width and height in percent of the body's.
        coat: paint of a vehicle; empty for none.
    """

    body: str
    percent: tuple[int, int, int] = (100, 100, 100)
    coat: str = ""

    @classmethod
    def of(cls, text: str) -> AssetName:
        """Read a name; what has not the form of one is all body."""
        found = _NAME.fullmatch(text)
        if found is None:
            return cls(text)
        x = int(found["x"] or 100)
        percent = (x, int(found["y"] or x), int(found["z"] or x))
        return cls(found["body"], percent, found["coat"] or "")

    def __str__(self) -> str:
        """Write the name."""
        x, y, z = self.percent
        size = (
            "" if self.percent == (100, 100, 100) else f"@{x}" if x == y == z else f"@{x}-{y}-{z}"
        )
        return f"{self.body}{size}" + (f"_{self.coat}" if self.coat else "")

    @property
    def unsized(self) -> str:
        """The name of the same in the body's own size."""
        return str(self._replace(percent=(100, 100, 100)))

    @property
    def factors(self) -> tuple[float, float, float]:
        """How often its sides are the body's."""
        x, y, z = self.percent
        return x / 100, y / 100, z / 100
