"""The result of a reconstruction: the contribution of imported geometry to a scene."""

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
    """A tree found in a survey; the scene generates its model.

    Attributes:
        x, y: position of the trunk, site frame, metres.
        height_m: height of the top above the ground.
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
    """Data for pictures of one source.

    Attributes:
        name: name of the source.
        registration: placement before and after registration, if it was registered.
        cleaning: state before and after cleaning.
    """

    name: str
    registration: Registration | None = None
    cleaning: CleaningPicture | None = None


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """The cleaned and labelled result of all sources of geometry, site frame.

    Attributes:
        mesh: buildings, vegetation and other objects, without the ground. ``part`` numbers its
            objects from 1.
        ground: the bare earth of the sources.
        trees: trees for the scene to generate.
        covers: areas where the map's own objects are left out: ``buildings``, ``trees``, ``other``.
        report: what was read, placed, removed and kept, for ``geometry.json``.
        figures: data for pictures of the sources.
        measured: area where the ground was measured at close range, with its curbs: detail finer
            than usual terrain is real there.
        surroundings: the data with which the sources were compared.
    """

    mesh: LabelledMesh
    ground: tuple[ElevationPatch, ...] = ()
    trees: tuple[SurveyedTree, ...] = ()
    covers: dict[str, shapely.Geometry] = field(default_factory=dict)
    report: dict[str, Any] = field(default_factory=dict)
    figures: tuple[SourceFigures, ...] = ()
    surroundings: Surroundings | None = None
    measured: shapely.Geometry = field(default_factory=shapely.MultiPolygon)
