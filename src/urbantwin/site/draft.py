"""Text of an initial ``site.yaml``: commented, and complete enough to run."""

from __future__ import annotations

import json
import os
import shutil
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import shapely

from urbantwin.artefact import check_file, overwriting, publish_file, replaced_file, sha256_of
from urbantwin.errors import InputError, readable
from urbantwin.geometry import SiteFrame
from urbantwin.pages.render import text_file
from urbantwin.site.fetched import FetchedInput
from urbantwin.site.pole_site import PolePosition
from urbantwin.site.region import (
    FARTHEST_M,
    circle,
    polygon_from_geojson,
    polygon_in_site,
    read_geojson,
)
from urbantwin.site.site import load_site

__all__ = [
    "RADIUS_M",
    "SENSOR",
    "SENSOR_COLUMNS",
    "GivenPlace",
    "SiteDraft",
    "check_target",
    "write_draft",
]

#: Sensor of an initial site: its model and its firings per turn.
SENSOR, SENSOR_COLUMNS = "OS1-128", 1024

#: Default radius of a region, metres.
RADIUS_M = 150.0


@dataclass(frozen=True)
class SiteDraft:
    """A proposed site.

    Attributes:
        title: the site's name.
        why: reason for the anchor's position, a sentence.
        latitude: latitude of the anchor, degrees, WGS84.
        longitude: longitude of the anchor, degrees, WGS84.
        region: a GeoJSON file with the region's polygon, or the radius of a circle, metres.
        osm: the OpenStreetMap extract, if there is one.
        roads: the map of the roads, if there is one.
        anchor_m: the anchor's x, y in that map, if it has no georeference.
        per_hour: actors per hour by class.
        pole: position of the sensor.
        about: sentences about the place for the file's header; empty ones separate paragraphs.
        traffic_remark: source of ``per_hour``, if not guessed from the map.
        guessed: whether ``per_hour`` is a guess.
        rig: indented text of the mapping ``rig``, instead of one sensor on ``pole``.
        fetched: fetched inputs, including the map.
    """

    title: str
    why: str
    latitude: float
    longitude: float
    region: Path | float
    osm: Path | None
    roads: Path | None
    anchor_m: tuple[float, float] | None
    per_hour: Mapping[str, int]
    pole: PolePosition
    about: Sequence[str] = ()
    traffic_remark: str = ""
    guessed: bool = True
    rig: str | None = None
    fetched: tuple[FetchedInput, ...] = ()


@dataclass(frozen=True)
class GivenPlace:
    """Place of a new site, as far as given.

    Attributes:
        point: latitude and longitude of the anchor, degrees.
        file: a GeoJSON file with the region's polygon.
        polygon: that polygon, longitude and latitude.
        radius_m: radius of a circle instead of the polygon, metres.
    """

    point: tuple[float, float] | None
    file: Path | None
    polygon: shapely.Polygon | None
    radius_m: float | None

    @classmethod
    def checked(
        cls,
        latitude: float | None,
        longitude: float | None,
        region: Path | None,
        radius_m: float | None,
    ) -> GivenPlace:
        """Check the given place.

        Raises:
            InputError: a value is out of range, one of a pair is missing, the region is given
                twice, or its file is wrong.
        """
        if region is not None and radius_m is not None:
            raise InputError("is given with a radius", file=region, expected="one of the two")
        if radius_m is not None and not 20.0 <= radius_m <= FARTHEST_M:
            raise InputError(f"the radius is {radius_m:g} m", expected=f"20 to {FARTHEST_M:g} m")
        polygon = polygon_from_geojson(read_geojson(region), file=region) if region else None
        if latitude is None and longitude is None:
            return cls(None, region, polygon, radius_m)
        if latitude is None or longitude is None:
            raise InputError("latitude and longitude go together", expected="both or neither")
        for name, value, most in (("latitude", latitude, 90.0), ("longitude", longitude, 180.0)):
            if not -most <= value <= most:
                problem = f"the {name} {value:g} is out of range"
                raise InputError(problem, expected=f"-{most:g} to {most:g}")
        return cls((latitude, longitude), region, polygon, radius_m)

    def region(self, frame: SiteFrame, radius_m: float) -> shapely.Polygon:
        """Return the region in the site frame: the polygon, or a circle of the given radius."""
        if self.polygon is None or self.file is None:
            return circle(radius_m)
        return polygon_in_site(self.polygon, frame, file=self.file)


def check_target(folder: Path, *, force: bool) -> None:
    """Check that a ``site.yaml`` may be written to a folder.

    Raises:
        InputError: it exists already, or the folder is a file or an artefact.
    """
    target = folder / "site.yaml"
    if target.exists() and not force:
        raise InputError("is there already", file=target, expected="a new folder, or --force")
    if folder.exists() and not folder.is_dir():
        raise InputError("is a file", file=folder, expected="a folder")
    with overwriting(allowed=force):
        check_file(target, kind=None)


def write_draft(folder: Path, draft: SiteDraft, *, force: bool) -> Path:
    """Write a draft as ``site.yaml`` and return its path.

    Files outside of ``folder`` are copied into it, so that it is self-contained.

    Raises:
        InputError: another file of the same name exists already.
    """
    target = folder / "site.yaml"
    folder.mkdir(parents=True, exist_ok=True)
    text = _text(folder, draft, force)
    scratch = folder / ".site.yaml.part"
    scratch.write_text(text, encoding="utf-8")
    try:
        load_site(scratch)
        with overwriting(allowed=force):
            publish_file(scratch, Path(os.path.realpath(target)), None, target=target)
    except InputError as error:
        raise InputError(
            error.problem, file=target, place=error.place, expected=error.expected
        ) from None
    finally:
        scratch.unlink(missing_ok=True)
    return target


def _brought_in(file: Path, folder: Path, force: bool) -> str:
    """Return the file's name relative to the folder, after copying a file from outside into it."""
    if file.resolve().is_relative_to(folder.resolve()):
        return file.resolve().relative_to(folder.resolve()).as_posix()
    target = folder / file.name
    if target.exists():
        if target.is_file() and sha256_of(target) == sha256_of(file):
            return file.name
        if not force or not target.is_file():
            raise InputError(
                f"differs from {file}", file=target, expected="a new folder, or --force"
            )
    with overwriting(allowed=force), replaced_file(target, kind=None) as scratch:
        shutil.copyfile(file, scratch)
    return file.name


def quoted(text: str) -> str:
    """Return a text in YAML, as a JSON string."""
    return json.dumps(text, ensure_ascii=not text.isprintable())


def _text(folder: Path, draft: SiteDraft, force: bool) -> str:
    """Return the text of the file, from the template ``first_site.yaml.j2``."""

    def named(file: Path) -> str:
        return _brought_in(file, folder, force)

    remark = f"How many come into the region per hour. {draft.traffic_remark}."
    return text_file(
        "site/first_site.yaml.j2",
        draft=draft,
        fetched=draft.fetched,
        polygon=named(draft.region) if isinstance(draft.region, Path) else "",
        about="".join(_remark(line) for line in ("", *draft.about)) if draft.about else "",
        traffic_remark=_remark(remark, indent="  "),
        named=named,
        quoted=quoted,
        readable=readable,
        sensor=SENSOR,
        columns=SENSOR_COLUMNS,
    )


def _remark(text: str, indent: str = "") -> str:
    """Return a comment of one paragraph."""
    lines = textwrap.wrap(text, 98 - len(indent), break_on_hyphens=False, break_long_words=False)
    return "".join(f"{indent}# {line}\n" for line in lines) or f"{indent}#\n"
