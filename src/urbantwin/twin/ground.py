"""The ground of a site and the geometry on it, from its DEM and imported sources."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from urbantwin.ground import Elevation, ElevationPatch, merged_elevation
from urbantwin.progress import Progress
from urbantwin.reconstruct import Reconstruction, surroundings_of
from urbantwin.reconstruct.georeference.height_system import SiteHeights
from urbantwin.roads.model import LaneModel, carriageway_in_plan
from urbantwin.site import OsmFeature, Site, read_heights

__all__ = ["SurveyedSite", "survey_ground"]


@dataclass(frozen=True)
class SurveyedSite:
    """The bare earth, and the imported geometry.

    Attributes:
        elevation: elevation of the bare earth; a horizontal plane if unknown.
        is_known: whether heights come from a DEM or another source of geometry.
        reconstruction: result of the sources of geometry; ``None`` without any.
        notes: sources of the heights.
    """

    elevation: Elevation
    is_known: bool
    reconstruction: Reconstruction | None
    notes: dict[str, object]


def survey_ground(
    site: Site,
    features: Sequence[OsmFeature],
    model: LaneModel | None,
    progress: Progress | None = None,
) -> SurveyedSite:
    """Read a site's DEM and its sources of geometry.

    Args:
        site: the site.
        features: mapped features of the region.
        model: the map of the roads; ``None`` without one.
        progress: called with the fraction done (0..1) and the current task.

    Raises:
        InputError: the DEM or a source cannot be used.
    """
    patches: list[ElevationPatch] = []
    notes: dict[str, object] = {}
    heights = None
    if site.dem is not None:
        grid = read_heights(site.dem.path, site.frame, site.region)
        heights = SiteHeights.of_dem(grid, site.dem.path.name)
        patches.append(
            ElevationPatch(
                grid.x0, grid.y0, grid.step_m, grid.heights, grid.source_step_m, heights.name
            )
        )
        notes = {
            "source": site.dem.path.name,
            "anchor_height_m": round(grid.anchor_height_m, 3),
            "missing_share": round(grid.missing_share, 4),
            "cell_m": round(grid.source_step_m, 3),
        }
    reconstruction = None
    if site.geometry:
        from urbantwin.reconstruct.build import reconstruct

        lanes = carriageway_in_plan(model, site.region) if model else None
        reconstruction = reconstruct(
            site.geometry,
            site.frame,
            surroundings_of(features, site.region, site.rig, lanes),
            dem=patches[0] if patches else None,
            heights=heights,
            progress=progress,
        )
        patches += reconstruction.ground
    if not patches:
        return SurveyedSite(
            Elevation.flat(), False, reconstruction, {"source": "no DEM: a level plain"}
        )
    if reconstruction is None or not reconstruction.ground:
        dem = patches[0]
        elevation = Elevation(dem.west, dem.south, dem.step, dem.heights, dem.detail_m)
        return SurveyedSite(elevation, True, reconstruction, notes)
    elevation, shares = merged_elevation(patches, site.region)
    return SurveyedSite(elevation, True, reconstruction, {**notes, "shares_of_region": shares})
