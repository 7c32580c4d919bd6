"""Aerial imagery in ``site.yaml``: orthophotos as GeoTIFF, and map tiles."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from urbantwin.download import VARIABLE, DownloadError, parse_address
from urbantwin.site.fetched import FetchedSpec
from urbantwin.site.web_source import OriginText, check_origins
from urbantwin.site.yaml_document import Document, wrong

__all__ = ["ImagerySource", "ImagerySpec"]

_EXPECTED = "an address such as https://host/{z}/{x}/{y}.png"


def _is_web(xyz: str | None) -> bool:
    return xyz is not None and "://" in xyz


class ImagerySpec(BaseModel):
    """One source of imagery: a GeoTIFF, or tiles of the Web Mercator grid.

    Attributes:
        file: a GeoTIFF of three bands (red, green, blue), or four with opacity; relative to
            ``site.yaml``.
        crs: coordinate reference system, if the file lacks it.
        xyz: instead of ``file``, the address of tiles with ``{z}``, ``{x}`` and ``{y}`` (or
            ``{-y}`` for rows counted from the south), or a pattern of local files.
        zoom: zoom level of the tiles; a pixel of zoom 19 is 0.3 m at the equator.
        key_env: environment variable with the address's key, which replaces ``{key}`` in the
            address, or else is added as ``key=``.
        origins: other permitted origins (``https://host:port``) of redirects; they do not receive
            the key.
        licence: licence of the imagery.
        attribution: author.
        fetched: origin of a fetched file, written by `init`.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    file: Annotated[str, Field(min_length=1)] | None = None
    crs: Annotated[str, Field(min_length=1)] | None = None
    xyz: Annotated[str, Field(min_length=1)] | None = None
    zoom: Annotated[int, Field(ge=10, le=24)] = 19
    key_env: Annotated[str, Field(pattern=VARIABLE)] | None = None
    origins: list[OriginText] = []
    licence: str = "not stated"
    attribution: str = "not stated"
    fetched: FetchedSpec | None = None

    @model_validator(mode="before")
    @classmethod
    def _short_form(cls, value: Any) -> Any:  # noqa: ANN401
        if isinstance(value, str):
            return {"xyz": value} if "{z}" in value else {"file": value}
        return value

    @field_validator("xyz")
    @classmethod
    def _has_places(cls, value: str | None) -> str | None:
        if value is not None:
            missing = [name for name in ("{z}", "{x}") if name not in value]
            missing += [] if "{y}" in value or "{-y}" in value else ["{y}"]
            unknown = set(re.findall(r"\{[^}]*\}", value)) - {"{z}", "{x}", "{y}", "{-y}", "{key}"}
            if missing or unknown:
                names = [name.strip("{}") for name in missing or sorted(unknown)]
                problem = f"{'lacks' if missing else 'holds'} {names[0]!r} in braces"
                raise wrong(problem, _EXPECTED)
            if "://" in value:
                try:
                    parse_address(value)
                except DownloadError as error:
                    raise wrong(str(error), _EXPECTED) from None
        return value

    @model_validator(mode="after")
    def _one_source(self) -> ImagerySpec:
        if (self.file is None) == (self.xyz is None):
            raise wrong("is not one picture", "file or xyz, and not both")
        if self.file is not None and {"zoom", "key_env"} & self.model_fields_set:
            raise wrong("has a zoom or a key for a file", "them for xyz only")
        if self.xyz is not None and self.crs is not None:
            raise wrong("has a crs for tiles", "none: tiles lie on the grid of EPSG:3857")
        if self.xyz is not None and "{key}" in self.xyz and self.key_env is None:
            raise wrong("has no key for {key}", "key_env: the name of an environment variable")
        check_origins(self.xyz if _is_web(self.xyz) else None, self.origins, "an address of tiles")
        return self


@dataclass(frozen=True)
class ImagerySource:
    """A GeoTIFF that is known to exist, or tiles.

    Attributes:
        spec: the user's specification.
        document: the ``site.yaml``, for error messages.
        number: index in the list.
    """

    spec: ImagerySpec
    document: Document
    number: int

    @property
    def path(self) -> Path | None:
        """Its file; ``None`` for tiles."""
        return None if self.spec.file is None else self.document.file.parent / self.spec.file

    @property
    def is_web(self) -> bool:
        """Whether its tiles come from an address."""
        return _is_web(self.spec.xyz)

    @property
    def name(self) -> str:
        """Name of the source in reports, without a key."""
        if self.path is not None:
            return self.path.name
        return re.sub(r"[?#].*", "", self.tiles)

    @property
    def tiles(self) -> str:
        """Address of its tiles; for a pattern of files, the last fixed folder and the pattern."""
        pattern = self.spec.xyz or ""
        if self.is_web:
            return pattern
        parts = pattern.replace("\\", "/").split("/")
        first = next((k for k, part in enumerate(parts) if "{" in part), 0)
        return "/".join(parts[max(0, first - 1) :])

    def place(self, *below: int | str) -> str:
        """Return the place of a field in ``site.yaml``: ``imagery[0].file (line 12)``."""
        return self.document.place(("imagery", self.number, *below))
