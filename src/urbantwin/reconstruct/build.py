"""The pipeline of imported geometry: read, georeference, clean, classify."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import shapely

from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh, SiteFrame, area_union
from urbantwin.ground import Elevation, ElevationPatch, merged_elevation
from urbantwin.io import read_model
from urbantwin.io.model import ImportedModel, PointCloud
from urbantwin.progress import Progress, between, untold
from urbantwin.reconstruct.airborne import AirborneModel, from_airborne, read_footprints
from urbantwin.reconstruct.classify import classified
from urbantwin.reconstruct.cleaning import CleaningPicture, cleaned, cleaned_cloud
from urbantwin.reconstruct.georeference import SiteHeights, placed
from urbantwin.reconstruct.plausibility import implausible_size, refuse_upside_down
from urbantwin.reconstruct.reconstruction import Reconstruction, SourceFigures, SurveyedTree
from urbantwin.reconstruct.recording.recorded_world import (
    labelled_world,
    placed_ground,
    read_recording,
)
from urbantwin.reconstruct.surroundings import Surroundings
from urbantwin.site import GeometrySource

__all__ = ["reconstruct"]

#: Margin around the region within which survey points are kept, metres, for complete buildings on
#: its border.
AROUND_M = 25.0


@dataclass
class _Gathered:
    """Results of the sources processed so far."""

    patches: list[ElevationPatch]
    meshes: list[LabelledMesh] = field(default_factory=list)
    parts: int = 0
    trees: list[SurveyedTree] = field(default_factory=list)
    covers: dict[str, list[shapely.Geometry]] = field(default_factory=dict)
    measured: list[shapely.Geometry] = field(default_factory=list)

    def add(self, mesh: LabelledMesh, covers: dict[str, shapely.Geometry]) -> None:
        """Add a mesh of objects, with numbers that continue those before."""
        moved = np.where(mesh.part > 0, mesh.part + self.parts, 0).astype(np.int32)
        self.meshes.append(replace(mesh, part=moved))
        self.parts += int(mesh.part.max(initial=0))
        for name, area in covers.items():
            self.covers.setdefault(name, []).append(area)

    def elevation(self, region: shapely.Polygon) -> Elevation | None:
        """Return the bare earth known so far."""
        return merged_elevation(self.patches, region)[0] if self.patches else None


def reconstruct(
    sources: Sequence[GeometrySource],
    frame: SiteFrame,
    surroundings: Surroundings,
    *,
    dem: ElevationPatch | None = None,
    heights: SiteHeights | None = None,
    progress: Progress | None = None,
) -> Reconstruction:
    """Read, georeference and clean every source, and separate the ground from objects.

    Sources are processed in order; one that gives the ground helps to place later ones. Clouds with
    equal settings in ``site.yaml`` form one survey.

    Args:
        sources: sources of ``site.yaml``.
        frame: the site frame.
        surroundings: the region, and the map's data there.
        dem: the elevation model, if there is one.
        heights: the anchor's ground height in the DEM's height system.
        progress: called with the fraction done (0..1) and the current step.

    Raises:
        InputError: a source cannot be read or placed, or has nothing within the region.
    """
    tell = progress or untold
    gathered = _Gathered([dem] if dem else [])
    reports: list[dict[str, Any]] = []
    figures: list[SourceFigures] = []
    surveys = [_survey_of(source) for source in sources]
    waiting: dict[str, list[PointCloud]] = {}
    for number, (source, survey) in enumerate(zip(sources, surveys, strict=True)):
        told = _part_of(tell, number, len(sources), source.name)
        told(0.0, "reading")
        if source.spec.kind == "recording" and source.path is not None:
            model = read_recording(source.path, between(told, 0.0, 0.3))
        else:
            model = read_model(source, frame, surroundings.region, told)
        told(0.3, "placing")
        elevation = gathered.elevation(surroundings.region)
        placement = placed(
            model, source, frame, surroundings, elevation, heights=heights, progress=told
        )
        heights = placement.heights
        report = _read_report(source, placement.model)
        report["placed"] = placement.report
        reports.append(report)
        told(0.5, "cleaning")
        picture = None
        if source.spec.kind == "recording":
            _take_recording(source, placement.model, surroundings, gathered, report)
            figures.append(SourceFigures(source.name, placement.registration))
            continue
        if placement.model.mesh is not None and len(placement.model.mesh.faces):
            picture = _take_mesh(
                source, placement.model, frame, surroundings, elevation, gathered, report
            )
        if placement.model.cloud is not None and len(placement.model.cloud.points):
            waiting.setdefault(survey, []).append(placement.model.cloud)
        if not report.get("mesh", {}).get("after", {}).get("triangles") and survey not in waiting:
            inside = "mesh" in report and report["mesh"]["before"]["triangles"] == 0
            raise _nothing_here(source, frame, "no triangle with an area" if inside else None)
        if survey in waiting and survey not in surveys[number + 1 :]:
            cloud = PointCloud.concatenate(waiting.pop(survey))
            picture = _take_cloud(source, cloud, frame, surroundings, gathered, report)
        figures.append(SourceFigures(source.name, placement.registration, picture))
    return Reconstruction(
        LabelledMesh.concatenate(gathered.meshes),
        tuple(gathered.patches[1 if dem else 0 :]),
        tuple(gathered.trees),
        {name: area_union(areas) for name, areas in sorted(gathered.covers.items())},
        {"sources": reports},
        tuple(figures),
        surroundings,
        area_union(gathered.measured),
    )


def _nothing_here(
    source: GeometrySource, frame: SiteFrame, problem: str | None = None
) -> InputError:
    return InputError(
        f"has {problem or 'nothing within the region'}",
        file=source.document.file,
        place=source.place(),
        expected=f"geometry around {frame.latitude:.6f}, {frame.longitude:.6f}",
    )


def _survey_of(source: GeometrySource) -> str:
    """Return a key that is equal for all files of one survey, which are arbitrary tiles."""
    own = {"file", "url", "licence", "attribution"}
    return source.spec.model_dump_json(exclude=own)


def _part_of(tell: Progress, number: int, count: int, name: str) -> Progress:
    """Return the progress callback of one of several sources."""
    return lambda share, text: tell((number + share) / count, f"{name}: {text}")


def _read_report(source: GeometrySource, model: ImportedModel) -> dict[str, Any]:
    return {
        "name": source.name,
        "licence": source.spec.licence,
        "attribution": source.spec.attribution,
        "files": model.files,
        "read": model.notes,
        "problems": list(model.problems),
    }


def _take_mesh(
    source: GeometrySource,
    model: ImportedModel,
    frame: SiteFrame,
    surroundings: Surroundings,
    elevation: Elevation | None,
    gathered: _Gathered,
    report: dict[str, Any],
) -> CleaningPicture | None:
    """Clean a mesh and add what the source provides."""
    assert model.mesh is not None
    if odd := implausible_size(model.mesh, source):
        report["problems"].append(f"{source.name} {odd}")
    refuse_upside_down(model.mesh, source)
    spec = source.spec
    clean = cleaned(
        model.mesh,
        spec.clean,
        region=surroundings.region,
        roads=surroundings.roads,
        sensors=surroundings.sensors,
        name=source.name,
        frame=frame,
    )
    report["mesh"] = clean.report
    if not len(clean.mesh.faces):
        return clean.picture
    told_apart = classified(
        clean.mesh, spec, elevation=elevation, roads=surroundings.roads, name=source.name
    )
    report["told_apart"] = told_apart.report
    if told_apart.ground is not None and "ground" in spec.provides:
        gathered.patches.append(told_apart.ground)
    elif not len(told_apart.mesh.faces):
        wanted = " or ".join(spec.provides)
        report["problems"].append(f"{source.name} gives nothing: no {wanted} was found in it")
    gathered.add(told_apart.mesh, told_apart.covers)
    return clean.picture


def _take_cloud(
    source: GeometrySource,
    cloud: PointCloud,
    frame: SiteFrame,
    surroundings: Surroundings,
    gathered: _Gathered,
    report: dict[str, Any],
) -> CleaningPicture | None:
    """Clean a cloud and add what the source provides."""
    spec, region = source.spec, surroundings.region
    clean = cleaned_cloud(
        cloud,
        spec.clean,
        region=region.buffer(AROUND_M),
        roads=surroundings.roads,
        name=source.name,
        frame=frame,
    )
    report["cloud"] = clean.report
    if not len(clean.cloud.points):
        raise _nothing_here(source, frame)
    footprints: Sequence[shapely.Polygon] = surroundings.footprints
    if source.footprints is not None:
        footprints = read_footprints(source.footprints, frame, region)
    survey: AirborneModel = from_airborne(
        clean.cloud, footprints=footprints, region=region, name=source.name
    )
    report["survey"] = survey.report
    if survey.ground is not None and "ground" in spec.provides:
        gathered.patches.append(survey.ground)
    wanted = {k: area for k, area in survey.covers.items() if k in spec.provides}
    houses = survey.buildings if "buildings" in spec.provides else LabelledMesh.empty()
    gathered.add(houses, wanted)
    if "trees" in spec.provides:
        gathered.trees += survey.trees
    return clean.picture


def _take_recording(
    source: GeometrySource,
    model: ImportedModel,
    surroundings: Surroundings,
    gathered: _Gathered,
    report: dict[str, Any],
) -> None:
    """Add the static world of a recording, which was cleaned when it was read."""
    assert model.mesh is not None
    assert model.cloud is not None
    provides, region = source.spec.provides, surroundings.region
    ground, measured = placed_ground(model.cloud, region, source.name)
    if "ground" in provides:
        gathered.patches.append(ground)
        gathered.measured.append(measured)
    report["survey"] = {
        "measured share of region": round(measured.area / max(region.area, 1e-9), 4)
    }
    standing = sorted({"trees", "other"} & set(provides))
    if standing:
        mesh, things = labelled_world(
            model.mesh, surroundings.roads, ground, without_traffic=source.spec.clean.traffic
        )
        gathered.add(mesh, dict.fromkeys(standing, measured))
        report["survey"] |= things
