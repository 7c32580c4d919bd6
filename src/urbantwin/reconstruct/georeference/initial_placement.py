"""A model's initial placement, and what registration may still change of it."""

from __future__ import annotations

from dataclasses import dataclass

from urbantwin.io.model import ImportedModel
from urbantwin.reconstruct.georeference.height_system import SiteHeights
from urbantwin.reconstruct.georeference.pose_search import Freedom

__all__ = ["InitialPlacement"]

#: What registration may change of a model whose place is said.
_NONE = Freedom()


@dataclass(frozen=True, eq=False)
class InitialPlacement:
    """A model on its first place.

    Attributes:
        model: site frame, metres.
        report: what was done.
        heights: what the site's zero is in the heights of a source.
        how: the method's name.
        said: the field of ``site.yaml`` that it comes from.
        problems: what a person should look at.
        freedom: what registration may still change.
    """

    model: ImportedModel
    report: dict[str, object]
    heights: SiteHeights | None
    how: str
    said: str | None = None
    problems: tuple[str, ...] = ()
    freedom: Freedom = _NONE
