"""Table of data sources with coverage, access and licence: ``sources.yaml``, and files like it.

A user's source has the same fields, and replaces a built-in one of the same name.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from urbantwin.download import VARIABLE, DownloadError, parse_address
from urbantwin.errors import InputError
from urbantwin.site.web_source import OriginText, check_origins
from urbantwin.site.yaml_document import nearest, read_document, wrong

__all__ = ["KINDS", "Kind", "SourceSpec", "chosen_sources", "known_sources", "read_sources"]

Kind = Literal["map", "names", "elevation", "airborne", "buildings", "imagery", "tiles"]
#: Kinds of inputs, in the order of fetching.
KINDS: tuple[Kind, ...] = ("map", "elevation", "airborne", "buildings", "imagery", "tiles")
#: Access methods of each kind.
ACCESS: Mapping[Kind, tuple[str, ...]] = {
    "map": ("overpass",),
    "names": ("nominatim",),
    "elevation": ("cog", "geotiff", "terrarium"),
    "airborne": ("copc", "ept"),
    "buildings": ("geoparquet",),
    "imagery": ("xyz",),
    "tiles": ("tileset",),
}
Degrees = Annotated[float, Field(ge=-180, le=180, allow_inf_nan=False)]
#: Allowed placeholders in an address, by access method; ``{key}`` is always allowed.
_BOX = ("west", "south", "east", "north")
_PLACES = {
    "cog": (*_BOX, "south_deg", "west_deg", "north_deg", "NS", "EW", "ns", "ew"),
    "geotiff": (*_BOX, "xmin", "ymin", "xmax", "ymax", "columns", "rows"),
    "terrarium": ("z", "x", "y", "-y"),
    "xyz": ("z", "x", "y", "-y"),
}


class IndexSpec(BaseModel):
    """Index that lists the files of a source.

    Attributes:
        url: address of GeoJSON (a list of tiles, a STAC search, a WFS response), which may hold
            ``{west}``, ``{south}``, ``{east}`` and ``{north}``; or of Overture's catalogue.
        kind: ``features``, or ``overture``.
        address: regular expression that matches whole strings of a feature that are file addresses.
        newest: property of a feature by which the newest of overlapping files is chosen.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    url: Annotated[str, Field(min_length=1)]
    kind: Literal["features", "overture"] = "features"
    address: Annotated[str, Field(min_length=1, max_length=200)] = r"https?://.*"
    newest: Annotated[str, Field(min_length=1)] | None = None

    @field_validator("address")
    @classmethod
    def _is_a_pattern(cls, value: str) -> str:
        try:
            re.compile(value)
        except re.error as error:
            raise wrong(f"is no pattern ({error})", "a regular expression") from None
        return value


class SourceSpec(BaseModel):
    """A data source.

    Attributes:
        name: name of the source (``--use``).
        title: description.
        kind: kind of input.
        access: access method.
        url: address; placeholders are listed in docs/reference/formats.md.
        mirrors: addresses with the same content, tried if the first fails.
        index: index of its files, if it is not a single file.
        origins: other origins that it refers to; they do not receive the key.
        coverage: west, south, east, north of the covered boxes, degrees; the whole earth if not
            given.
        countries: countries with data (ISO 3166-1 alpha-2); boxes extend into neighbours.
        resolution_m: spacing of heights, points or pixels, metres; the finest source comes first.
        crs: CRS of its files, if they lack it or its vertical datum.
        zoom: zoom level of tiles.
        licence: licence of its data.
        attribution: required attribution.
        terms: address of its terms of use.
        key_env: environment variable of the key that it needs.
        default: whether it is used without being named.
        fresh_days: largest age of a cached response, days.
        pause_s: pause between two requests, seconds.
        think_s: time limit for its server's response, seconds; 20 s if not given.
        caution: warning about its data.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9-]{0,59}$", description="a-z, 0-9 and -")]
    title: Annotated[str, Field(min_length=1)]
    kind: Kind
    access: Literal[
        "overpass", "nominatim", "cog", "geotiff", "terrarium", "copc", "ept", "geoparquet", "xyz",
        "tileset",
    ]  # fmt: skip
    url: Annotated[str, Field(min_length=1)] | None = None
    mirrors: list[str] = []
    index: IndexSpec | None = None
    origins: list[OriginText] = []
    coverage: list[Annotated[list[Degrees], Field(min_length=4, max_length=4)]] | None = None
    countries: list[Annotated[str, Field(pattern="^[A-Z]{2}$", description="AT")]] | None = None
    resolution_m: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    crs: Annotated[str, Field(min_length=1)] | None = None
    zoom: Annotated[int, Field(ge=10, le=22)] | None = None
    licence: Annotated[str, Field(min_length=1)] = "not stated"
    attribution: Annotated[str, Field(min_length=1)] = "not stated"
    terms: str | None = None
    key_env: Annotated[str, Field(pattern=VARIABLE)] | None = None
    default: bool = True
    fresh_days: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 90.0
    pause_s: Annotated[float, Field(ge=0, le=60, allow_inf_nan=False)] = 0.0
    think_s: Annotated[float, Field(ge=0, le=600, allow_inf_nan=False)] = 0.0
    caution: str | None = None

    @model_validator(mode="after")
    def _fits_together(self) -> SourceSpec:
        if self.access not in ACCESS[self.kind]:
            raise wrong(
                f"has the access {self.access!r} to {self.kind}", " or ".join(ACCESS[self.kind])
            )
        if (self.url is None) == (self.index is None):
            raise wrong("is not one source", "url or index, and not both")
        if self.index is not None and self.access not in ("cog", "copc", "ept", "geoparquet"):
            raise wrong(f"has an index for {self.access}", "url")
        if self.access in ("terrarium", "xyz") and self.zoom is None:
            raise wrong("has tiles without a zoom", "zoom")
        known = _BOX if self.index else _PLACES.get(self.access, ())
        for text in (self.address, *self.mirrors):
            _check_braces(text, known, has_key=self.key_env is not None)
        if self.access == "geotiff" and re.search(r"\{[xy]m", self.address) and self.crs is None:
            raise wrong("asks for a box in metres without a crs", "crs")
        check_origins(self.address, self.origins, "a url")
        return self

    @property
    def address(self) -> str:
        """Address that is requested first."""
        return self.index.url if self.index else self.url or ""

    def covers(self, box: tuple[float, float, float, float], country: str) -> bool:
        """Return whether the source may have data in a box (degrees) in a country."""
        if self.countries is not None and country not in self.countries:
            return False
        if self.coverage is None:
            return True
        west, south, east, north = box
        return any(
            one[0] < east and one[2] > west and one[1] < north and one[3] > south
            for one in self.coverage
        )


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)
    sources: list[SourceSpec]


def read_sources(path: Path) -> list[SourceSpec]:
    """Read a table of sources.

    Raises:
        InputError: the file is missing or has an error; names the field and the line.
    """
    document = read_document(path, kind="a table of sources")
    found = document.validated(_Table).sources
    names = [one.name for one in found]
    for number, name in enumerate(names):
        if name in names[:number]:
            raise document.error(
                f"is {name!r} twice", ("sources", number, "name"), "a name for each"
            )
    return found


@cache
def known_sources() -> tuple[SourceSpec, ...]:
    """Return the sources of ``sources.yaml``."""
    with as_file(files("urbantwin.acquire") / "sources.yaml") as path:
        return tuple(read_sources(path))


def chosen_sources(
    own: Path | None = None, use: Sequence[str] = (), also: Sequence[str] = ()
) -> list[SourceSpec]:
    """Return the permitted sources, the finest of each kind first.

    Args:
        own: the user's own table, whose sources are added and replace built-in ones of the same
            name.
        use: names of the only sources to use, instead of the default ones.
        also: names of sources to use besides the default ones.

    Raises:
        InputError: the table is wrong, or a name is unknown.
    """
    table = {one.name: one for one in known_sources()}
    if own is not None:
        table |= {one.name: one for one in read_sources(own)}
    for option, names in (("--use", use), ("--also", also)):
        for name in names:
            if name not in table:
                raise InputError(
                    f"names the unknown source {name!r:.60}",
                    place=option,
                    expected=nearest(name, sorted(table)),
                )
    named = {*use, *also}
    usual = [
        one for one in table.values()
        if one.name in named or (not use and one.default) or one.kind == "names"
    ]  # fmt: skip
    return sorted(usual, key=lambda one: (one.resolution_m or 0.0, one.name not in named))


def _check_braces(text: str, known: Sequence[str], *, has_key: bool) -> None:
    """Check that an address is valid and holds known placeholders only."""
    try:
        parse_address(text)
    except DownloadError as error:
        raise wrong(f"has an address that {error}", "https://...") from None
    for name in re.findall(r"\{([^}]*)\}", text):
        plain = name.partition(":")[0]
        if plain == "key":
            if not has_key:
                raise wrong("has no key for {key}", "key_env: the name of an environment variable")
        elif plain not in known:
            raise wrong(f"holds {plain!r} in braces", nearest(plain, [*known, "key"]))
