"""The result of a reconstruction: what imported geometry contributes to a scene."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import shapely

from urbantwin.geometry import LabelledMesh
from urbantwin.ground import ElevationPatch
from urbantwin.reconstruct.surroundings import Surroundings

if TYPE_CHECKING:
    from urbantwin.reconstruct.cleaning import CleaningPicture
    from urbantwin.reconstruct.georeference import Registration

__all__ = ["Reconstruction", "SourceFigures", "SurveyedTree"]


@dataclass(frozen=True)
class SurveyedTree:
    """A tree that was found in a survey; the scene grows it.

    Attributes:
        x, y: of the trunk, site frame, metres.
        height_m: from its ground to its top.
        crown_m: diameter of the crown.
        crown_base_m: height of the crown's underside above the ground.
    """

    x: float
    y: float
    height_m: float
    crown_m: float
    crown_base_m: float


@dataclass(frozen=True, eq=False)
class SourceFigures:
    """What pictures of one source show.

    Attributes:
        name: of the source.
        registration: where it came from and where it went, if it was registered.
        cleaning: what it was before and after.
    """

    name: str
    registration: Registration | None = None
    cleaning: CleaningPicture | None = None


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """Everything that sources of geometry give, cleaned and labelled, site frame.

    Attributes:
        mesh: buildings, vegetation and other things that stand; the ground is not among them.
            ``part`` numbers its objects from 1.
        ground: the bare earth as the sources have it.
        trees: trees for the scene to grow.
        covers: where the map's own things are left out: ``buildings``, ``trees``, ``other``.
        report: what was read, placed, removed and kept, for ``geometry.json``.
        figures: what pictures of the sources show.
        measured: where the ground was measured from close by, with its curbs: what is finer there
            than terrain usually is, is real.
        surroundings: what the sources were compared with.
    """

    mesh: LabelledMesh
    ground: tuple[ElevationPatch, ...] = ()
    trees: tuple[SurveyedTree, ...] = ()
    covers: dict[str, shapely.Geometry] = field(default_factory=dict)
    report: dict[str, Any] = field(default_factory=dict)
    figures: tuple[SourceFigures, ...] = ()
    surroundings: Surroundings | None = None
    measured: shapely.Geometry = field(default_factory=shapely.MultiPolygon)
