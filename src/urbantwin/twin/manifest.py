"""Validation of a twin's ``twin.json`` and ``site.yaml``."""

from __future__ import annotations

from pathlib import Path, PurePosixPath
from typing import Annotated, Literal

import shapely
from pydantic import BaseModel, ConfigDict, Field

from urbantwin.artefact.manifest import Part, Sha256
from urbantwin.errors import InputError
from urbantwin.site.calibration import Reflectivities
from urbantwin.site.traffic import TrafficSpec

__all__ = ["Corrected", "KeptSite", "TwinManifest", "check_region", "file_inside"]

#: Maximum extent of a region from its anchor, metres.
_FURTHEST_M = 1e5
_Metres = Annotated[float, Field(ge=-_FURTHEST_M, le=_FURTHEST_M)]
_Count = Annotated[int, Field(ge=0, lt=2**53)]
_Place = Annotated[list[_Metres], Field(min_length=2, max_length=2)]


class _Anchor(Part):
    latitude: Annotated[float, Field(ge=-90, le=90)]
    longitude: Annotated[float, Field(ge=-180, le=180)]


class _Input(Part):
    name: str
    licence: str
    attribution: str


class _Ground(Part):
    anchor_height_m: Annotated[float, Field(ge=-20_000, le=20_000)] | None = None


class _Mapped(Part):
    found: _Count
    mapped: _Count


class _Materials(Part):
    reflectivity: Reflectivities = Field(default_factory=dict)


class _Sensors(Part):
    seen: Annotated[float, Field(ge=0, le=1)] | None = None


class Corrected(Part):
    """The outcome of a correction; ``at_m``: lines and points, site frame, metres."""

    number: _Count
    what: str
    applied: bool
    told: str
    at_m: list[list[_Place]]


class _Corrections(Part):
    each: list[Corrected] = Field(default_factory=list)


class _Notes(Part):
    ground: _Ground | None = None
    mapped: dict[str, _Mapped] = Field(default_factory=dict)
    materials: _Materials = _Materials()
    sensors: _Sensors = _Sensors()
    corrections: _Corrections = _Corrections()


class TwinManifest(Part):
    """``twin.json``."""

    kind: Literal["twin"]
    version: str
    name: str
    anchor: _Anchor
    driving_side: Literal["right", "left"]
    region_m: Annotated[list[_Place], Field(min_length=3)]
    inputs: list[_Input]
    notes: _Notes
    files: dict[str, Sha256]


class KeptSite(BaseModel):
    """The part of a twin's ``site.yaml`` that later stages read: its traffic."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    traffic: TrafficSpec
    closed_loop: bool = False


def check_region(told: TwinManifest, file: Path) -> None:
    """Check that the region encloses an area.

    Raises:
        InputError: it does not.
    """
    region = shapely.Polygon(told.region_m)
    if not region.is_valid or region.area <= 0:
        raise InputError(
            "encloses no area", file=file, place="region_m", expected="the corners of a polygon"
        )


def file_inside(folder: Path, name: str, *, manifest: Path) -> Path:
    """Return the path of a file named by a manifest, which must be in its folder.

    Raises:
        InputError: the name leads out of the folder, by itself or by a link.
    """
    parts = PurePosixPath(name).parts
    plain = bool(parts) and ".." not in parts and not name.startswith("/") and "\0" not in name
    if plain and "\\" not in name:
        path = folder / name
        try:
            if path.resolve().is_relative_to(folder.resolve()):
                return path
        except (OSError, RuntimeError):  # circular links
            pass
    raise InputError(
        f"names {name[:60]!r}", file=manifest, place="files", expected="files in its folder"
    )
