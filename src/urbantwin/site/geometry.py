"""Sources of imported geometry in ``site.yaml``: meshes, 3D Tiles, point clouds."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from urbantwin.download import VARIABLE
from urbantwin.site.fetched import FetchedSpec
from urbantwin.site.web_source import OriginText, check_origins
from urbantwin.site.yaml_document import Document, nearest, wrong
from urbantwin.taxonomy import material_id, semantic_classes

__all__ = [
    "PROVIDED",
    "CleanSpec",
    "ControlPoint",
    "GeometrySource",
    "GeometrySpec",
    "OriginSpec",
    "RegisterSpec",
    "SimilaritySpec",
    "Spot",
]

#: Kinds of content that can be taken from a source.
PROVIDED = ("ground", "buildings", "trees", "other")
Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Triple = Annotated[list[Number], Field(min_length=3, max_length=3)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class OriginSpec(_Strict):
    """Geotag: position and heading of a model's origin.

    Attributes:
        latitude: degrees, WGS84.
        longitude: degrees, WGS84.
        height_m: height of the origin above the site's ground at the anchor, metres; if not given,
            the model's ground is aligned with the site's.
        heading_deg: heading of the model's north (+y of a z-up model), degrees clockwise from
            north.
    """

    latitude: Annotated[float, Field(ge=-90, le=90, allow_inf_nan=False)]
    longitude: Annotated[float, Field(ge=-180, le=180, allow_inf_nan=False)]
    height_m: Number | None = None
    heading_deg: Number = 0.0


class SimilaritySpec(_Strict):
    """``site = scale R model + translation``, R = Rz(yaw) Ry(pitch) Rx(roll), degrees.

    Applied after the model was turned z-up.
    """

    scale: Positive = 1.0
    yaw_deg: Number = 0.0
    pitch_deg: Number = 0.0
    roll_deg: Number = 0.0
    translation_m: Triple = [0.0, 0.0, 0.0]


class ControlPoint(_Strict):
    """A point known in the model (its own units and axes) and in the site.

    The site's side is either ``site_m`` (x, y, z of the site frame) or latitude, longitude and
    ``height_m`` above the anchor's ground.
    """

    model: Triple
    site_m: Triple | None = None
    latitude: Annotated[float, Field(ge=-90, le=90, allow_inf_nan=False)] | None = None
    longitude: Annotated[float, Field(ge=-180, le=180, allow_inf_nan=False)] | None = None
    height_m: Number | None = None

    @model_validator(mode="after")
    def _one_place(self) -> ControlPoint:
        lonlat = (self.latitude is not None) + (self.longitude is not None)
        if (self.site_m is None) == (lonlat == 0) or lonlat == 1:
            raise wrong("is not one place", "site_m, or latitude and longitude (and height_m)")
        return self


class RegisterSpec(_Strict):
    """Registration to the ground and the roads, coarse to fine.

    Attributes:
        search_m: largest horizontal shift from the initial position, metres.
        search_deg: largest rotation, degrees; 180 searches all headings.
        scale: also search for the scale.
        worst_residual_m: largest accepted residual, metres.
    """

    search_m: Positive = 20.0
    search_deg: Annotated[float, Field(ge=0.0, le=180.0, allow_inf_nan=False)] = 180.0
    scale: bool = False
    worst_residual_m: Positive = 1.0


class Spot(_Strict):
    """A piece that cleaning must keep or remove: all with their centre within ``radius_m``.

    Attributes:
        at_m: x, y (or x, y, z) of the site frame, metres.
        latitude: instead of ``at_m``, degrees.
        longitude: instead of ``at_m``, degrees.
        radius_m: radius, metres.
    """

    at_m: Annotated[list[Number], Field(min_length=2, max_length=3)] | None = None
    latitude: Annotated[float, Field(ge=-90, le=90, allow_inf_nan=False)] | None = None
    longitude: Annotated[float, Field(ge=-180, le=180, allow_inf_nan=False)] | None = None
    radius_m: Positive = 3.0

    @model_validator(mode="after")
    def _one_place(self) -> Spot:
        lonlat = (self.latitude is not None) + (self.longitude is not None)
        if (self.at_m is None) == (lonlat == 0) or lonlat == 1:
            raise wrong("is not one place", "at_m, or latitude and longitude")
        return self


class CleanSpec(_Strict):
    """Cleaning steps of a source; each is optional.

    Attributes:
        shards: remove floating and tiny pieces.
        smallest_m: pieces whose longest side is below this are shards, metres.
        traffic: remove cars and other traffic from the surface.
        chordal_error_m: largest displacement of the surface by decimation, metres; 0 for none.
            ``None`` for less than a LiDAR resolves at a triangle's distance to the nearest sensor.
        keep: pieces that are always kept.
        remove: pieces that are always removed.
    """

    shards: bool = True
    smallest_m: Positive = 0.5
    traffic: bool = True
    chordal_error_m: Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)] | None = None
    keep: list[Spot] = []
    remove: list[Spot] = []


class GeometrySpec(_Strict):
    """A source of geometry.

    Attributes:
        file: file, relative to ``site.yaml`` (or a folder: a photogrammetry export).
        url: instead of ``file``, the address of a ``tileset.json``.
        key_env: environment variable with the address's key.
        origins: other permitted origins (``https://host:port``) of its tiles; they do not receive
            the key.
        kind: format; ``auto`` detects it from the file. A ``recording`` is frames of static sensors
            at the site.
        crs: coordinate reference system if the file lacks it (``EPSG:7415``), including the
            vertical datum if heights matter.
        height_offset_m: offset added to its heights, metres.
        unit: length unit; ``auto`` detects it.
        up: upward axis; ``auto`` detects it.
        geometric_error_m: 3D Tiles are refined down to this error, metres.
        origin: geotag of its origin.
        control_points: points known in it and in the site, or the name of a CSV file of them.
        similarity: the transform to the site frame.
        register_to: registration to the ground and the roads; ``true`` for its defaults.
        provides: kinds of content taken from it, which replace the map's.
        footprints: outlines of buildings for a point cloud: GeoPackage, GeoJSON, SpatiaLite.
        semantic: semantic class of the whole source; ``auto`` classifies its parts.
        material: material of the whole source; ``auto`` infers it from names and colours.
        clean: cleaning steps.
        licence: licence of the source.
        attribution: author.
        fetched: origin of a fetched file, written by `init`.
    """

    file: Annotated[str, Field(min_length=1)] | None = None
    url: Annotated[str, Field(min_length=1)] | None = None
    key_env: Annotated[str, Field(pattern=VARIABLE)] | None = None
    origins: list[OriginText] = []
    kind: Literal["auto", "tiles", "mesh", "cloud", "cityjson", "photogrammetry", "recording"] = (
        "auto"
    )
    crs: Annotated[str, Field(min_length=1)] | None = None
    height_offset_m: Number = 0.0
    unit: Literal["auto", "m", "cm", "mm", "km", "ft", "us-ft", "in"] | Positive = "auto"
    up: Literal["auto", "y", "z"] = "auto"
    geometric_error_m: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] = 0.5
    origin: OriginSpec | None = None
    control_points: str | Annotated[list[ControlPoint], Field(min_length=1)] | None = None
    similarity: SimilaritySpec | None = None
    register_to: RegisterSpec | None = Field(default=None, alias="register")
    provides: list[str] = list(PROVIDED)
    footprints: Annotated[str, Field(min_length=1)] | None = None
    semantic: str = "auto"
    material: str = "auto"
    clean: CleanSpec = CleanSpec()
    licence: str = "not stated"
    attribution: str = "not stated"
    fetched: FetchedSpec | None = None

    #: File names of fields (used in error messages).
    also_written_as: ClassVar[tuple[str, ...]] = ("register",)

    @model_validator(mode="before")
    @classmethod
    def _short_forms(cls, value: Any) -> Any:  # noqa: ANN401
        if isinstance(value, str):
            is_web = re.match(r"https?://", value, re.IGNORECASE)
            value = {"url": value} if is_web else {"file": value}
        if isinstance(value, dict) and isinstance(value.get("register"), bool):
            value = {**value, "register": {} if value["register"] else None}
        return value

    @field_validator("provides")
    @classmethod
    def _known_kinds(cls, value: list[str]) -> list[str]:
        if not value:
            raise wrong("is empty", f"some of {', '.join(PROVIDED)}")
        for name in value:
            if name not in PROVIDED:
                raise wrong(f"holds {name!r}", nearest(name, PROVIDED))
        return value

    @field_validator("semantic")
    @classmethod
    def _known_class(cls, value: str) -> str:
        if value != "auto" and value not in semantic_classes():
            raise wrong(f"is {value!r}", f"auto, or {nearest(value, list(semantic_classes()))}")
        return value

    @field_validator("material")
    @classmethod
    def _known_material(cls, value: str) -> str:
        if value != "auto":
            try:
                material_id(value)
            except KeyError:
                raise wrong(
                    f"is {value!r}", "auto, or a name from the table of materials"
                ) from None
        return value

    @model_validator(mode="after")
    def _one_source(self) -> GeometrySpec:
        if (self.file is None) == (self.url is None):
            raise wrong("is not one source", "file or url, and not both")
        if self.kind == "recording" and self.file is None:
            raise wrong("is a recording at an address", "file: a folder of frames")
        if self.url is None and self.key_env is not None:
            raise wrong("has key_env without a url", "the address that the key is for")
        check_origins(self.url, self.origins, "a url")
        given = [self.origin, self.control_points, self.similarity]
        if sum(item is not None for item in given) > 1:
            raise wrong("is placed twice", "one of origin, control_points and similarity")
        return self


@dataclass(frozen=True)
class GeometrySource:
    """A source of geometry whose files are known to exist.

    Attributes:
        spec: the user's specification.
        document: the ``site.yaml``, for error messages.
        number: index of the source in the list.
    """

    spec: GeometrySpec
    document: Document
    number: int

    @property
    def path(self) -> Path | None:
        """Its file or folder; ``None`` for an address."""
        return None if self.spec.file is None else self.document.file.parent / self.spec.file

    @property
    def footprints(self) -> Path | None:
        """File of building outlines, if named."""
        name = self.spec.footprints
        return None if name is None else self.document.file.parent / name

    @property
    def name(self) -> str:
        """Name of the source in reports."""
        if self.path is not None:
            return self.path.name
        return re.sub(r"[?#].*|(?<=//)[^/@]*@", "", self.spec.url or "").rstrip("/")

    def place(self, *below: int | str) -> str:
        """Return the place of a field in ``site.yaml``: ``geometry[0].crs (line 12)``."""
        return self.document.place(("geometry", self.number, *below))
