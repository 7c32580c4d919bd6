"""Registration of a model to the ground, the roads and the outlines of buildings."""

from __future__ import annotations

from dataclasses import dataclass

from urbantwin.ground import Elevation
from urbantwin.reconstruct.georeference.similarity import Similarity
from urbantwin.reconstruct.model import ImportedModel
from urbantwin.reconstruct.surroundings import Surroundings
from urbantwin.site.geometry import GeometrySource

__all__ = ["Registration", "register"]


@dataclass(frozen=True, eq=False)
class Registration:
    """How a model was moved."""

    transform: Similarity
    report: dict[str, object]


def register(
    model: ImportedModel,
    source: GeometrySource,
    surroundings: Surroundings,
    elevation: Elevation | None,
    *,
    heading_known: bool,
    place_known: bool,
    scale_known: bool,
    level_known: bool,
) -> Registration:
    """Register."""
    raise NotImplementedError
