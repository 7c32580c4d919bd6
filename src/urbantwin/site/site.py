"""``site.yaml``: the user's description of a place, checked and with all defaults filled in."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import shapely
from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from urbantwin.artefact import sha256_of
from urbantwin.geometry import SiteFrame
from urbantwin.site.conditions import Clutter, SceneSpec
from urbantwin.site.corrections import CORRECTIONS, read_corrections
from urbantwin.site.dem import check_dem
from urbantwin.site.extract import Extract
from urbantwin.site.extract_coverage import check_roads
from urbantwin.site.fetched import FetchedSpec, InputFile, check_fetched
from urbantwin.site.geometry import GeometrySource, GeometrySpec
from urbantwin.site.imagery import ImagerySource, ImagerySpec
from urbantwin.site.region import (
    FARTHEST_M,
    circle,
    polygon_from_geojson,
    polygon_in_site,
    read_geojson,
)
from urbantwin.site.rig import RigSpec, load_rig_spec, rig_spec_from
from urbantwin.site.signals import SignalPlan, SignalSpec
from urbantwin.site.traffic import OwnAssetSpec, TrafficSpec
from urbantwin.site.yaml_document import Document, must_exist, read_document, wrong

__all__ = ["InputFile", "Site", "check_extract", "load_site"]

#: File name of the user's own street objects, beside the site.
STREET_OBJECTS = "street_objects.yaml"

Metres = Annotated[float, Field(ge=-1e8, le=1e8, allow_inf_nan=False)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class _Anchor(_Strict):
    latitude: Annotated[float, Field(ge=-90, le=90, allow_inf_nan=False)] = Field(
        description="degrees north, WGS84"
    )
    longitude: Annotated[float, Field(ge=-180, le=180, allow_inf_nan=False)] = Field(
        description="degrees east, WGS84"
    )


class _Region(_Strict):
    radius_m: Annotated[float, Field(allow_inf_nan=False)] | None = None
    polygon: str | dict[str, Any] | None = None

    @field_validator("radius_m")
    @classmethod
    def _radius_is_sensible(cls, value: float | None) -> float | None:
        if value is None:
            return None
        if value <= 0:
            raise wrong(f"is {value:g} m", f"a radius of 20 to {FARTHEST_M:g} m")
        if value < 20:
            raise wrong(f"is {value:g} m, too small for a junction", "at least 20 m")
        if value > FARTHEST_M:
            problem = f"is {value:g} m, where rays in single precision lose millimetres"
            raise wrong(problem, f"at most {FARTHEST_M:g} m")
        return value

    @field_validator("polygon", mode="before")
    @classmethod
    def _polygon_is_one(cls, value: Any) -> Any:  # noqa: ANN401
        if not isinstance(value, str | dict):
            raise wrong("is neither", "the name of a GeoJSON file, or a GeoJSON geometry")
        return value

    @model_validator(mode="after")
    def _one_of_two(self) -> _Region:
        if (self.radius_m is None) == (self.polygon is None):
            raise wrong("is not one shape", "radius_m or polygon, and not both")
        return self


class _File(_Strict):
    file: Annotated[str, Field(min_length=1, description="the name of a file")]
    licence: str = "not stated"
    attribution: str = "not stated"
    fetched: FetchedSpec | None = None

    @model_validator(mode="before")
    @classmethod
    def _plain_name(cls, value: Any) -> Any:  # noqa: ANN401
        return {"file": value} if isinstance(value, str) else value


class _OsmFile(_File):
    licence: str = "ODbL-1.0"
    attribution: str = "© OpenStreetMap contributors"


class _Roads(_Strict):
    file: Annotated[str, Field(min_length=1)] | None = None
    licence: str = "not stated"
    attribution: str = "not stated"
    anchor_m: Annotated[list[Metres], Field(min_length=2, max_length=2)] | None = None
    driving_side: Literal["auto", "left", "right"] = "auto"

    @model_validator(mode="before")
    @classmethod
    def _plain_name(cls, value: Any) -> Any:  # noqa: ANN401
        return {"file": value} if isinstance(value, str) else value

    @model_validator(mode="after")
    def _of_a_file(self) -> _Roads:
        given = self.model_fields_set & {"licence", "attribution", "anchor_m"}
        if self.file is None and given:
            raise wrong(f"has {min(given)} without a file", "file: a map of the roads")
        return self


class _SiteFile(_Strict):
    name: Annotated[str, Field(min_length=1)] = "site"
    anchor: _Anchor = Field(description="latitude and longitude of the junction")
    region: _Region = _Region(radius_m=150.0)
    osm: _OsmFile | None = None
    sketch: _File | None = None
    dem: _File | None = None
    corrections: _File | None = None
    street_objects: _File | None = None
    buildings: _File | None = None
    roads: _Roads = _Roads()
    geometry: list[GeometrySpec] = []
    imagery: list[ImagerySpec] = []
    signals: list[SignalSpec] = []
    scene: SceneSpec = SceneSpec()
    closed_loop: bool = True
    traffic: TrafficSpec = TrafficSpec()
    rig: str | dict[str, Any] = Field(description="the sensors, or the name of a rig's file")

    @field_validator("rig", mode="before")
    @classmethod
    def _rig_is_one(cls, value: Any) -> Any:  # noqa: ANN401
        if not isinstance(value, str | dict):
            raise wrong("is neither", "a mapping with sensors, or the name of a rig's file")
        return value


@dataclass(frozen=True)
class Site:
    """A site that passed all checks except those that need the map.

    Attributes:
        file: the ``site.yaml`` that it was read from.
        name: name of the site.
        latitude: latitude of the anchor, degrees, WGS84.
        longitude: longitude of the anchor, degrees, WGS84.
        region: region of interest, site frame, metres.
        radius_m: radius of a circular region, metres.
        osm: the OpenStreetMap extract; ``None`` only with a map of the roads, a sketch, or a
            recording of the place without any map, which then has no roads.
        dem: the elevation model, if there is one.
        driving_side: ``left``, ``right``, or ``auto`` (that of the map of the roads, else of the
            country).
        traffic: volumes and duration of the traffic.
        rig: the sensors.
        rig_file: file with the rig.
        signals: given signal programs, used instead of assumed ones.
        closed_loop: whether outer roads beyond the region connect every exit with an entrance, so
            that the same vehicles circulate.
        roads: a map of the roads, OpenDRIVE or Lanelet2, that is used instead of the extract's.
        anchor_m: the anchor's x, y in that map, if it has no georeference.
        geometry: meshes, 3D Tiles and point clouds for the scene.
        imagery: aerial imagery, from which the ground's materials are classified.
        outline: the region's given ring, longitude and latitude, degrees; empty for a circle.
        clutter: objects beside the streets: ``typical``, ``mapped`` or ``none``.
        sketch: a hand-drawn sketch, used instead of the extract.
        corrections: the user's corrections of the map and the twin.
        street_objects: the user's own kinds of street objects.
        buildings: footprints with heights, which complete those of the extract.
    """

    file: Path
    name: str
    latitude: float
    longitude: float
    region: shapely.Polygon
    radius_m: float | None
    osm: InputFile | None
    dem: InputFile | None
    driving_side: Literal["auto", "left", "right"]
    traffic: TrafficSpec
    rig: RigSpec
    rig_file: Path
    signals: tuple[SignalPlan, ...] = ()
    closed_loop: bool = True
    roads: InputFile | None = None
    anchor_m: tuple[float, float] | None = None
    geometry: tuple[GeometrySource, ...] = ()
    imagery: tuple[ImagerySource, ...] = ()
    outline: tuple[tuple[float, float], ...] = ()
    clutter: Clutter = "typical"
    sketch: InputFile | None = None
    corrections: InputFile | None = None
    street_objects: InputFile | None = None
    buildings: InputFile | None = None

    @cached_property
    def frame(self) -> SiteFrame:
        """The site frame: east-north-up metres at the anchor."""
        return SiteFrame(self.latitude, self.longitude)

    def resolved(self) -> dict[str, Any]:
        """Return the site as stored in a twin: defaults filled in, file names without folders.

        Written as YAML beside its input files, it loads as the same site.
        """
        region: dict[str, Any] = {"radius_m": self.radius_m}
        if self.radius_m is None:
            # As given: transforming there and back would change the last bits.
            ring = [list(point) for point in self.outline]
            region = {"polygon": {"type": "Polygon", "coordinates": [ring]}}
        value: dict[str, Any] = {
            "name": self.name,
            "anchor": {"latitude": self.latitude, "longitude": self.longitude},
            "region": region,
        }
        value |= {kind: _file_entry(one) for kind, one in self._maps().items() if kind != "roads"}
        roads: dict[str, Any] = _file_entry(self.roads) if self.roads else {}
        if self.anchor_m:
            roads["anchor_m"] = list(self.anchor_m)
        return {
            **value,
            "roads": {**roads, "driving_side": self.driving_side},
            **self._geometry(),
            **self._imagery(),
            **self._signals(),
            "scene": {"clutter": self.clutter},
            "closed_loop": self.closed_loop,
            "traffic": self._traffic(),
            "rig": self.rig.written(),
        }

    @property
    def own_assets(self) -> list[tuple[OwnAssetSpec, Path]]:
        """Meshes added to the catalogue of actors, with their files."""
        return [(one, self.file.parent / one.file) for one in self.traffic.assets]

    def _traffic(self) -> dict[str, Any]:
        empty = {name for name in ("size", "assets") if not getattr(self.traffic, name)}
        value = self.traffic.model_dump(exclude=empty)
        if self.traffic.assets:
            value["assets"] = [
                one.model_dump(by_alias=True, exclude_defaults=True) | {"file": path.name}
                for one, path in self.own_assets
            ]
        return value

    def _geometry(self) -> dict[str, Any]:
        sources = []
        for source in self.geometry:
            spec = source.spec.model_dump(
                exclude_none=True, exclude_defaults=True, exclude={"fetched"}, by_alias=True
            )
            for name in ("file", "footprints", "control_points"):
                if isinstance(spec.get(name), str):
                    spec[name] = Path(spec[name]).name
            sources.append(spec)
        return {"geometry": sources} if sources else {}

    def _imagery(self) -> dict[str, Any]:
        pictures = []
        for source in self.imagery:
            spec = source.spec.model_dump(
                exclude_none=True, exclude_defaults=True, exclude={"fetched"}
            )
            if source.path is not None:
                spec["file"] = source.path.name
            else:
                spec["xyz"] = source.tiles
            pictures.append(spec)
        return {"imagery": pictures} if pictures else {}

    def _signals(self) -> dict[str, Any]:
        plans = [plan.spec.model_dump(exclude_none=True) for plan in self.signals]
        return {"signals": plans} if plans else {}

    def _maps(self) -> dict[str, InputFile]:
        """Return the files named by fields of their own."""
        kinds = ("osm", "sketch", "roads", "dem", "corrections", "street_objects", "buildings")
        return {kind: getattr(self, kind) for kind in kinds if getattr(self, kind)}

    def files(self) -> list[Path]:
        """Return all files and folders that the site names, including its own file."""
        given: list[Path | None] = [file.path for file in self._maps().values()]
        given += [source.path for source in self.geometry]
        given += [picture.path for picture in self.imagery]
        named = [path for path in given if path is not None]
        return [self.file, self.rig_file, *named, *(path for _, path in self.own_assets)]

    def inputs(self) -> list[dict[str, str]]:
        """Return the site's inputs: kind, name, sha256, licence and attribution."""
        sources = [
            {
                # The kind "recording" is known before the frames are read.
                "kind": "recording" if getattr(source.spec, "kind", "") == "recording" else kind,
                "name": source.name,
                # The checksums of folders and addresses are in geometry.json.
                "sha256": sha256_of(source.path) if source.path and source.path.is_file() else "",
                "licence": source.spec.licence,
                "attribution": source.spec.attribution,
            }
            for kind, group in (("geometry", self.geometry), ("imagery", self.imagery))
            for source in group
        ]
        return [
            {
                "kind": kind,
                "name": item.path.name,
                "sha256": sha256_of(item.path),
                "licence": item.licence,
                "attribution": item.attribution,
            }
            for kind, item in self._maps().items()
        ] + [
            *sources,
            *(
                {
                    "kind": "actor",
                    "name": path.name,
                    "sha256": sha256_of(path),
                    "licence": one.licence,
                    "attribution": one.attribution,
                }
                for one, path in self.own_assets
            ),
        ]


def _file_entry(item: InputFile) -> dict[str, str]:
    return {"file": item.path.name, "licence": item.licence, "attribution": item.attribution}


def load_site(path: Path) -> Site:
    """Read and check a ``site.yaml``. Paths in it are relative to it.

    Args:
        path: the file, or the folder that it is in.

    Raises:
        InputError: the file is missing or wrong; names file, field and line. Checks against the map
            are in `check_extract`.
    """
    if path.is_dir() and (path / "site.yaml").is_file():
        path = path / "site.yaml"
    document = read_document(path, kind="a site")
    raw = document.validated(_SiteFile)
    frame = SiteFrame(raw.anchor.latitude, raw.anchor.longitude)
    region, outline = _region(document, raw.region, frame)
    recorded = any(one.kind == "recording" for one in raw.geometry)
    mapped = raw.osm or raw.sketch or raw.roads.file
    if mapped is None and not recorded:
        expected = "an OpenStreetMap extract, or else a map of the roads (roads.file) or a sketch"
        raise document.error("is missing", ("osm",), expected)
    if raw.sketch is not None and raw.osm is not None:
        raise document.error("is given beside an extract (osm)", ("sketch",), "one of the two")
    sketch = _input_file(document, "sketch", raw.sketch, "GeoJSON") if raw.sketch else None
    osm = _input_file(document, "osm", raw.osm, "an OpenStreetMap extract") if raw.osm else None
    roads = None
    if raw.roads.file is not None:
        given = _File(
            file=raw.roads.file, licence=raw.roads.licence, attribution=raw.roads.attribution
        )
        roads = _input_file(document, "roads", given, "a map of the roads (.xodr, Lanelet2 .osm)")
    dem = _input_file(document, "dem", raw.dem, "a DEM as GeoTIFF") if raw.dem else None
    if dem:
        check_dem(dem.path, frame, region)
    corrections = _beside(document, raw, "corrections", CORRECTIONS, "corrections as GeoJSON")
    if corrections:
        read_corrections(corrections.path, frame, region)
    buildings = None
    if raw.buildings is not None:
        if raw.osm is None:
            raise document.error(
                "is given without an extract (osm)", ("buildings",), "a map that it completes"
            )
        buildings = _input_file(document, "buildings", raw.buildings, "footprints as GeoJSON")
    if isinstance(raw.rig, str):
        rig_file = path.parent / raw.rig
        must_exist(document, ("rig",), rig_file, "a rig as YAML")
        rig = load_rig_spec(rig_file, frame)
    else:
        rig_file = path
        rig = rig_spec_from(document.part("rig"), frame)
    for number, one in enumerate(raw.traffic.assets):
        where = ("traffic", "assets", number, "file")
        must_exist(document, where, path.parent / one.file, "a mesh as glTF")
    return Site(
        file=path,
        name=raw.name,
        latitude=frame.latitude,
        longitude=frame.longitude,
        region=region,
        radius_m=raw.region.radius_m,
        osm=osm,
        dem=dem,
        driving_side=raw.roads.driving_side,
        traffic=raw.traffic,
        rig=rig,
        rig_file=rig_file,
        signals=tuple(SignalPlan(spec, document, k) for k, spec in enumerate(raw.signals)),
        closed_loop=raw.closed_loop,
        roads=roads,
        anchor_m=(raw.roads.anchor_m[0], raw.roads.anchor_m[1]) if raw.roads.anchor_m else None,
        geometry=_geometry_sources(document, raw.geometry),
        imagery=_imagery_sources(document, raw.imagery),
        outline=outline,
        clutter=raw.scene.clutter,
        sketch=sketch,
        corrections=corrections,
        street_objects=_beside(
            document, raw, "street_objects", STREET_OBJECTS, "street objects as YAML"
        ),
        buildings=buildings,
    )


def _geometry_sources(document: Document, specs: list[GeometrySpec]) -> tuple[GeometrySource, ...]:
    sources = tuple(GeometrySource(spec, document, k) for k, spec in enumerate(specs))
    for source in sources:
        where = ("geometry", source.number)
        if source.path is not None:
            kind = "a mesh, a tileset.json, a point cloud or a folder of photogrammetry"
            must_exist(document, (*where, "file"), source.path, kind, folders=True)
            check_fetched(document, where, source.path, source.spec.fetched)
        if source.footprints is not None:
            kind = "outlines of buildings (GeoPackage, GeoJSON, SpatiaLite)"
            must_exist(document, (*where, "footprints"), source.footprints, kind)
    return sources


def _imagery_sources(document: Document, specs: list[ImagerySpec]) -> tuple[ImagerySource, ...]:
    sources = tuple(ImagerySource(spec, document, k) for k, spec in enumerate(specs))
    for source in sources:
        if source.path is not None:
            where = ("imagery", source.number)
            must_exist(document, (*where, "file"), source.path, "a picture as GeoTIFF")
            check_fetched(document, where, source.path, source.spec.fetched)
    return sources


def check_extract(site: Site, extract: Extract) -> None:
    """Check that the extract has roads in the site's region, as `check_roads` does."""
    check_roads(extract, site.frame, site.region, f"the region of {site.file.name}")


def _region(
    document: Document, raw: _Region, frame: SiteFrame
) -> tuple[shapely.Polygon, tuple[tuple[float, float], ...]]:
    """Return the region in the site frame, and the given ring of a polygon."""
    if raw.radius_m is not None:
        return circle(raw.radius_m), ()
    file, place = document.file, None
    if isinstance(raw.polygon, str):
        file = document.file.parent / raw.polygon
        must_exist(document, ("region", "polygon"), file, "a GeoJSON file")
        geojson = read_geojson(file)
    else:
        place = document.place(("region", "polygon"))
        geojson = raw.polygon or {}
    lonlat = polygon_from_geojson(geojson, file=file, place=place)
    ring = tuple((float(x), float(y)) for x, y in shapely.get_coordinates(lonlat))
    return polygon_in_site(lonlat, frame, file=file, place=place), ring


def _beside(
    document: Document, raw: _SiteFile, field: str, name: str, kind: str
) -> InputFile | None:
    """Return the file named by a field, or else the file with the default name beside the site."""
    given = getattr(raw, field)
    if given is not None:
        return _input_file(document, field, given, kind)
    beside = document.file.parent / name
    if field in raw.model_fields_set or not beside.is_file():
        return None
    terms = _File(file=name)
    return InputFile(beside, terms.licence, terms.attribution)


def _input_file(document: Document, field: str, raw: _File, kind: str) -> InputFile:
    path = document.file.parent / raw.file
    must_exist(document, (field, "file"), path, kind)
    check_fetched(document, (field,), path, raw.fetched)
    return InputFile(path, raw.licence, raw.attribution)
