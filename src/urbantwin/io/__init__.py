"""Readers of external files: points, meshes, city models, tiles, packets, bags.

Files are not trusted: sizes are checked, numbers must be finite, exceptions of libraries become
one-line errors with the file and the reason, and native code runs in a child process with limits.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.io.kinds import holds_model
    from urbantwin.io.read import read_model

__all__ = ["holds_model", "read_model"]

names_on_demand(__name__)
