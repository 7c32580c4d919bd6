"""Names of assets: a body, a coat, and a size of its own: ``car-sedan_black@4.70x1.85x1.45``.

The size is length, width and height in metres, in centimetres' steps, so that actors of the same
size share a mesh.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from urbantwin.traffic.assets.coat import COATS

__all__ = ["AssetName", "Size", "sized_name"]

#: Length, width and height, metres.
Size = tuple[float, float, float]

_SIZED = re.compile(r"(.+)@(\d+\.\d\d)x(\d+\.\d\d)x(\d+\.\d\d)")
#: Nothing is smaller than this, metres.
_LEAST_M = 0.01


class AssetName(NamedTuple):
    """What the name of an asset says.

    Attributes:
        body: name in the catalogue.
        coat: paint of a vehicle; empty for none.
        size: of this actor; ``None`` for the body's own.
    """

    body: str
    coat: str = ""
    size: Size | None = None

    @classmethod
    def of(cls, text: str) -> AssetName:
        """Read a name."""
        found = _SIZED.fullmatch(text)
        size = None if found is None else (float(found[2]), float(found[3]), float(found[4]))
        bare = text if found is None else found[1]
        body, between, coat = bare.rpartition("_")
        return cls(body, coat, size) if between and coat in COATS else cls(bare, "", size)

    def __str__(self) -> str:
        """Write the name."""
        name = f"{self.body}_{self.coat}" if self.coat else self.body
        return name if self.size is None else sized_name(name, *self.size)

    @property
    def unsized(self) -> str:
        """The name of the same in the body's own size."""
        return str(self._replace(size=None))


def sized_name(name: str, length: float, width: float, height: float) -> str:
    """Return the name of an asset with another size, metres; at least a centimetre each way."""
    sides = (max(side, _LEAST_M) for side in (length, width, height))
    return f"{name}@{'x'.join(f'{side:.2f}' for side in sides)}"
