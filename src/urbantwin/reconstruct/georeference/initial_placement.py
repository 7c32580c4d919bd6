"""A model's initial placement, and the freedom of registration."""

from __future__ import annotations

from dataclasses import dataclass

from urbantwin.io.model import ImportedModel
from urbantwin.reconstruct.georeference.height_system import SiteHeights
from urbantwin.reconstruct.georeference.pose_search import Freedom

__all__ = ["InitialPlacement"]

#: No freedom, for models with a stated placement.
_NONE = Freedom()


@dataclass(frozen=True, eq=False)
class InitialPlacement:
    """A model at its initial placement.

    Attributes:
        model: site frame, metres.
        report: what was done.
        heights: the site's zero in known heights.
        how: name of the method.
        said: field of ``site.yaml`` that defines it.
        problems: warnings for the user.
        freedom: what registration may change.
    """

    model: ImportedModel
    report: dict[str, object]
    heights: SiteHeights | None
    how: str
    said: str | None = None
    problems: tuple[str, ...] = ()
    freedom: Freedom = _NONE
