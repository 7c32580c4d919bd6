"""From a model in its own frame to the same model on site."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.reconstruct.georeference.heights import SiteHeights
from urbantwin.reconstruct.model import ImportedModel
from urbantwin.reconstruct.surroundings import Surroundings
from urbantwin.site.geometry import GeometrySource

__all__ = ["Placed", "placed"]

Progress = Callable[[float, str], None]


@dataclass(frozen=True, eq=False)
class Placed:
    """A model on site.

    Attributes:
        model: in the site frame: east-north-up metres, z above the anchor's ground, float64.
        report: how it was placed, for ``geometry.json``: method, systems, transformations with
            their accuracy, scale, upward axis and why, offsets, residuals.
        heights: what the site's zero is in the heights of a source: to be handed to the next one.
        figure: what a picture of the placing shows, or ``None``.
    """

    model: ImportedModel
    report: dict[str, object]
    heights: SiteHeights | None
    figure: object | None = field(default=None)


def placed(
    model: ImportedModel,
    source: GeometrySource,
    frame: SiteFrame,
    surroundings: Surroundings,
    elevation: Elevation | None,
    *,
    heights: SiteHeights | None = None,
    progress: Progress | None = None,
) -> Placed:
    """Place a model on site.

    Args:
        model: as it was read.
        source: what ``site.yaml`` says of it.
        frame: the site frame.
        surroundings: region, roads and footprints to compare it with.
        elevation: the bare earth so far; ``None`` or a level plain where nothing is known of it.
        heights: what the anchor's ground is in known heights (`SiteHeights.of_dem`, or what an
            earlier source gave); ``None`` where nothing is known: this source then says it.
        progress: told the share done (0..1) and what is being done.

    Raises:
        InputError: it cannot be placed, or not without a guess; the line says what is missing.
    """
    raise NotImplementedError
