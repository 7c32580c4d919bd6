"""Inputs of ``init`` fetched from public sources into the site's folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from urbantwin.errors import InputError
from urbantwin.interface.place import AnyPath
from urbantwin.progress import Progress, between
from urbantwin.result_warning import ResultWarning

if TYPE_CHECKING:
    from urbantwin.acquire import Area, SourceSpec, Web
    from urbantwin.site.fetched import FetchedInput
    from urbantwin.site.presets import Preset

__all__ = ["FetchOptions", "FetchedInputs", "fetched_inputs"]

#: Subfolder of a site with fetched inputs.
INPUTS = "inputs"


@dataclass(frozen=True)
class FetchOptions:
    """Options of ``init`` about fetching."""

    at: str | tuple[float, float] | None
    place: str | None
    use: str | Sequence[str] | None
    also: str | Sequence[str] | None
    sources: AnyPath | None
    cache: AnyPath | None
    offline: bool
    #: Place where a dataset was recorded.
    preset: Preset | None = None
    #: Largest distance (m) from the true position, for a preset's own place.
    within_m: float = 0.0

    def of_preset(self) -> FetchOptions:
        """Return the options with the preset's place, if published and no other place is named."""
        place = None if self.preset is None else self.preset.place
        if self.is_asked or place is None:
            return self
        return replace(self, at=(place.latitude, place.longitude), within_m=place.within_m)

    @property
    def named(self) -> str:
        """The option that names the place."""
        if self.preset is not None and self.within_m:
            return f"--preset {self.preset.name}"
        return "--at" if self.place is None else "--place"

    def reach_m(self, radius_m: float | None) -> float | None:
        """Return the radius around the place within which inputs are needed, metres."""
        from urbantwin.site.region import FARTHEST_M

        if self.preset is None:
            return radius_m
        radius_m = radius_m or self.preset.radius_m
        return radius_m if radius_m > FARTHEST_M else min(radius_m + self.within_m, FARTHEST_M)

    @property
    def is_asked(self) -> bool:
        """Whether anything is to be fetched."""
        return self.at is not None or self.place is not None

    def check_alone(
        self, *, roads: Path | None, lat: float | None, lon: float | None, at_junction: bool
    ) -> None:
        """Check that the options are compatible.

        Raises:
            InputError: two options name the place, or an option has no effect.
        """
        if self.at is not None and self.place is not None:
            raise InputError("is given with --place", place="--at", expected="one of the two")
        for option, value in (
            ("--lat", lat), ("--lon", lon), ("--at-junction", at_junction or None),
            ("--roads", roads),
        ):  # fmt: skip
            if self.is_asked and value is not None:
                raise InputError(
                    f"is given with {option}", place=self.named, expected="one of the two"
                )
        if not self.is_asked:
            for option, given in (
                ("--use", self.use), ("--also", self.also), ("--sources", self.sources),
                ("--cache", self.cache), ("--offline", self.offline),
            ):  # fmt: skip
                if given:
                    raise InputError(
                        "is given, and nothing is to be fetched",
                        place=option,
                        expected="--at LAT,LON or --place beside it",
                    )


@dataclass(frozen=True)
class FetchedInputs:
    """Fetched inputs of a site.

    Attributes:
        extract: the map.
        point: latitude and longitude of the place, degrees.
        inputs: all files, as named in ``site.yaml``.
        rows: outcome of each source.
        warnings: failures.
    """

    extract: Path
    point: tuple[float, float]
    inputs: tuple[FetchedInput, ...]
    rows: tuple[dict[str, str], ...]
    warnings: tuple[ResultWarning, ...]


def fetched_inputs(
    folder: Path,
    options: FetchOptions,
    extract: Path | None,
    region: Path | None,
    radius_m: float | None,
    *,
    force: bool,
    tell: Progress,
) -> FetchedInputs:
    """Fetch the inputs of a place into ``inputs`` of a site's folder.

    Args:
        folder: the site's folder.
        options: options about fetching.
        extract: an existing map, which is used instead of a fetched one.
        region: GeoJSON polygon of the region.
        radius_m: radius of the region, metres.
        force: replace files in ``inputs``.
        tell: called with the fraction done and a description.

    Raises:
        InputError: the place is invalid, is not the preset's, has no streets, or has no map.
    """
    try:
        return _fetched(folder, options, extract, region, radius_m, force=force, tell=tell)
    except InputError as error:
        if error.place != "--at" or error.file is not None:
            raise
        expected = error.expected or ""
        if options.preset is not None:
            from urbantwin.site.presets import where_extracts_are

            there = where_extracts_are(options.preset)
            own = options.within_m and "--osm FILE" not in expected
            expected = there if own else expected.replace("--osm FILE", there)
        raise InputError(error.problem, place=options.named, expected=expected) from None


def _fetched(
    folder: Path,
    options: FetchOptions,
    extract: Path | None,
    region: Path | None,
    radius_m: float | None,
    *,
    force: bool,
    tell: Progress,
) -> FetchedInputs:
    from urbantwin.acquire import (
        AnswerCache,
        Web,
        acquire_inputs,
        chosen_sources,
        sources_of,
        usual_cache,
    )
    from urbantwin.artefact import claimed
    from urbantwin.artefact.disk_space import says_no_room
    from urbantwin.site.draft import check_target
    from urbantwin.site.extract_coverage import check_roads
    from urbantwin.site.extract_file import box_around, read_extract

    check_target(folder, force=force)
    own = None if options.sources is None else Path(options.sources)
    table = chosen_sources(own, _names(options.use), _names(options.also))
    cache = usual_cache() if options.cache is None else Path(options.cache)
    web = Web(AnswerCache(cache), offline=options.offline)
    area = _area(options, table, web, region, radius_m, between(tell, 0.0, 0.1))
    if extract is not None:
        near = read_extract(extract, box_around(area.frame, area.circle))
        check_roads(near, area.frame, area.circle, "the region")
    with (
        claimed(folder / INPUTS) as scratch,
        says_no_room(folder / INPUTS, scratch.folder),
    ):
        found = acquire_inputs(
            area,
            scratch.folder,
            sources_of(table),
            web,
            without=("map",) if extract is not None else (),
            progress=between(tell, 0.1, 1.0),
        )
        inputs = tuple(
            one if one.path is None else replace(one, path=folder / INPUTS / one.path.name)
            for one in found.noted()
        )
        _put(scratch.folder, inputs, force=force)
    maps = [one.path for one in inputs if one.kind == "map" and one.path is not None]
    return FetchedInputs(
        extract or maps[0],
        (area.latitude, area.longitude),
        inputs,
        tuple(one.row() for one in found.attempts),
        found.warnings,
    )


def _area(
    options: FetchOptions,
    table: Sequence[SourceSpec],
    web: Web,
    region: Path | None,
    radius_m: float | None,
    tell: Progress,
) -> Area:
    """Return the requested place, with a circle around the region."""
    from urbantwin.acquire import Area, find_place, parse_place
    from urbantwin.site.draft import RADIUS_M, GivenPlace
    from urbantwin.site.presets import check_place

    if options.place is not None:
        named = find_place(options.place, table, web, tell)
        point = round(named.latitude, 6), round(named.longitude, 6)
    elif isinstance(options.at, str):
        point = parse_place(options.at)
    else:
        assert options.at is not None
        point = float(options.at[0]), float(options.at[1])
    area = Area.checked(*point, RADIUS_M if radius_m is None else radius_m)
    if options.preset is not None:
        check_place(options.preset, area.latitude, area.longitude)
    if region is None:
        return area
    import numpy as np
    import shapely

    given = GivenPlace.checked(*point, region, radius_m)
    corners = shapely.get_coordinates(given.region(area.frame, area.radius_m))
    return Area(*point, float(np.hypot(*corners.T).max()))


def _names(told: str | Sequence[str] | None) -> list[str]:
    """Return names given as a list, or as text separated by commas."""
    return [one.strip() for one in told.split(",")] if isinstance(told, str) else [*(told or ())]


def _put(scratch: Path, inputs: Sequence[FetchedInput], *, force: bool) -> None:
    """Move fetched files into the site's folder.

    Raises:
        InputError: another file has one of the names.
    """
    from urbantwin.artefact import overwriting, publish_file, sha256_of

    files = [one for one in inputs if one.path is not None and one.fetched is not None]
    for one in files:
        assert one.path is not None
        assert one.fetched is not None
        if (
            one.path.exists()
            and not force
            and (not one.path.is_file() or sha256_of(one.path) != one.fetched.sha256)
        ):
            raise InputError(
                "differs from what was fetched",
                file=one.path,
                expected="a new folder, or --force",
            )
    for one in files:
        assert one.path is not None
        one.path.parent.mkdir(parents=True, exist_ok=True)
        with overwriting(allowed=True):  # checked above
            publish_file(scratch / one.path.name, one.path.resolve(), None)
