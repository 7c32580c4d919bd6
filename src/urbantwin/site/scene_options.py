"""``scene:`` of a site: what stands beside its streets."""

from __future__ import annotations

from typing import Literal

from urbantwin.site.conditions import Strict

__all__ = ["Clutter", "SceneSpec"]

#: What stands beside streets: what is mapped, with what is typical where the map is silent, or
#: neither.
Clutter = Literal["typical", "mapped", "none"]


class SceneSpec(Strict):
    """Options of the scene.

    Attributes:
        clutter: what stands beside the streets.
    """

    clutter: Clutter = "typical"
