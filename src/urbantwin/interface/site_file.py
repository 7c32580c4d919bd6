"""Sites: a commented ``site.yaml`` proposed for a place on a map, or opened."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import Ge, Interval

from urbantwin.artefact import new_folder
from urbantwin.errors import InputError
from urbantwin.interface.command import command
from urbantwin.interface.place import AnyPath
from urbantwin.interface.stage import ShowProgress, shown_stage, tell_result
from urbantwin.interface.summary import Artefact, Summary
from urbantwin.progress import between

if TYPE_CHECKING:
    from urbantwin.interface.fetched_inputs import FetchOptions
    from urbantwin.site import SensorSpec
    from urbantwin.site import Site as CheckedSite
    from urbantwin.site.pole_site import PoleGround, PolePosition
    from urbantwin.site.presets import Preset

__all__ = ["Site", "init"]


class Site(Artefact):
    """A ``site.yaml``; it can be passed as its file: ``ut.build(site)``.

    Attributes:
        path: the file.
        sources: requested sources of its inputs: ``kind``, ``source``, ``outcome`` and ``told``
            (message) of each; empty if nothing was fetched.
    """

    def __init__(self, path: AnyPath, sources: Sequence[Mapping[str, str]] = ()) -> None:
        self.path = Path(path)
        self.sources = [dict(one) for one in sources]

    @classmethod
    def open(cls, path: AnyPath) -> Site:
        """Open and check a file.

        Raises:
            InputError: the file, or a file that it names, is missing or wrong.
        """
        found = cls(path)
        assert found.checked is not None  # read now to report errors at once
        return found

    @cached_property
    def checked(self) -> CheckedSite:
        """The site with all defaults filled in."""
        from urbantwin.site import load_site

        return load_site(self.path)

    def __repr__(self) -> str:
        """Return name, place, area and file."""
        site = self.checked
        return (
            f"Site {site.name!r} at {site.latitude:.5f}, {site.longitude:.5f}: "
            f"{site.region.area:,.0f} m2, {len(site.rig.sensors)} sensors ({self.path})"
        )

    def resolved(self) -> Summary:
        """Return the site with all defaults filled in."""
        resolved = self.checked.resolved()
        resolved["region"] = {"area_m2": round(self.checked.region.area, 1)}
        return Summary(
            {"path": str(self.path), "kind": "site", **resolved, "inputs": self.checked.inputs()}
        )

    def summary(self) -> Summary:
        """Return the values that ``init`` chose, and the next command."""
        site = self.checked
        sensors = {one.name: f"{one.model}, {_height_of(one)}" for one in site.rig.sensors}
        return Summary(
            path=str(self.path),
            kind="site",
            name=site.name,
            anchor={"latitude": site.latitude, "longitude": site.longitude},
            region={"area_m2": round(site.region.area, 1)},
            traffic_per_hour={name: n for name, n in site.traffic.per_hour.items() if n},
            sensors=sensors,
            **({"sources": self.sources} if self.sources else {}),
            next=f"urbantwin run {shlex.quote(str(self.path))}",
        )


def _height_of(sensor: SensorSpec) -> str:
    if sensor.height_m is not None:
        return f"{sensor.height_m:g} m above the ground"
    return f"{sensor.up_m:g} m above the anchor's ground"


@command
def init(
    folder: AnyPath,
    *,
    osm: AnyPath | None = None,
    roads: AnyPath | None = None,
    out: AnyPath | None = None,
    lat: Annotated[float | None, Interval(ge=-90, le=90)] = None,
    lon: Annotated[float | None, Interval(ge=-180, le=180)] = None,
    at_junction: bool = False,
    radius: Annotated[float | None, Ge(20)] = None,
    region: AnyPath | None = None,
    preset: str | None = None,
    at: Annotated[str | tuple[float, float] | None, "LAT,LON"] = None,
    place: str | None = None,
    use: str | Sequence[str] | None = None,
    also: str | Sequence[str] | None = None,
    sources: AnyPath | None = None,
    cache: AnyPath | None = None,
    offline: bool = False,
    key_env: Sequence[str] | None = None,
    allow_key: Sequence[str] | None = None,
    force: bool = False,
    progress: ShowProgress = True,
) -> Site:
    """Write a commented site.yaml for a place or a map.

    With ``at`` or ``place``, inputs are fetched from public sources into ``inputs`` beside it, with
    source, date and licence of each.

    Args:
        folder: folder to write the file in; with ``out``, the map instead.
        osm: OpenStreetMap extract: osm, osm.bz2, osm.gz or osm.pbf.
        roads: map of the roads, used instead of the extract's: OpenDRIVE (xodr) or Lanelet2 (osm).
        out: folder to write if the first argument is a map.
        lat: latitude of the anchor, degrees, WGS84.
        lon: longitude of the anchor, degrees, WGS84.
        at_junction: use the busiest signalised junction of the map; the default without
            coordinates.
        radius: radius of the region of interest around the anchor, metres.
        region: region of interest: a GeoJSON polygon.
        preset: name of a place where a dataset was recorded (``site presets``): sets anchor,
            region, sensors and traffic as published; without ``osm``, inputs are fetched.
        at: latitude and longitude of a place whose inputs are fetched from public sources:
            ``"48.1374,11.5755"``.
        place: name of that place instead: ``"street and street, town"``, or any name.
        use: sources to request, separated by commas; no others are used.
        also: sources to request besides the default ones, separated by commas.
        sources: table of further sources (docs/reference/formats.md).
        cache: folder of cached responses; the user's cache if not given.
        offline: make no requests; use the cache alone.
        key_env: environment variables that the table of sources may use as keys, beside those whose
            names begin with ``URBANTWIN_``.
        allow_key: ``NAME=https://host``: variable, and the server that its key may be sent to.
        force: replace a ``site.yaml``.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: no map, an incomplete or ambiguous place, an unusable map, a place without
            streets, no network, or a key that is not allowed.

    Example:
        >>> site = ut.init("mysite", osm="map.osm.pbf", lat=60.1699, lon=24.9384)
        >>> site = ut.init("s110", preset="tumtraf-s110")
        >>> site = ut.init("mysite", at=(48.1374, 11.5755), radius=120)
        $ urbantwin init mysite/ --at 48.1374,11.5755
    """
    from urbantwin.download import keys_allowed
    from urbantwin.interface.fetched_inputs import FetchOptions, fetched_inputs
    from urbantwin.lidar.sight import place_in_sight, warnings_of_place
    from urbantwin.roads.imported import init_site_of_map
    from urbantwin.site.initial_site import init_site
    from urbantwin.site.presets import init_preset_site
    from urbantwin.site.presets import preset as preset_of

    target = Path(folder)
    extract = None if osm is None else Path(osm)
    streets = None if roads is None else Path(roads)
    area = None if region is None else Path(region)
    if out is not None:
        target, extract, streets = _map_first(target, Path(out), extract, streets)
    chosen_place = None if preset is None else preset_of(preset)
    options = FetchOptions(at, place, use, also, sources, cache, offline, chosen_place)
    if extract is None and lat is None and lon is None and not at_junction:
        options = options.of_preset()
    _check_choice(options, chosen_place, extract, streets, lat, lon, at_junction=at_junction)
    chosen: list[PolePosition] = []

    def choose_pole(ground: PoleGround) -> PolePosition:
        chosen.append(place_in_sight(ground))
        return chosen[-1]

    found = None
    with (
        keys_allowed(key_env, allow_key),
        new_folder(target),
        shown_stage("init", progress) as tell,
    ):
        if options.is_asked:
            reach = radius if area is not None else options.reach_m(radius)
            found = fetched_inputs(
                target, options, extract, area, reach, force=force, tell=between(tell, 0.0, 0.8)
            )
            extract = found.extract
            if not options.within_m:
                lat, lon = found.point
            tell = between(tell, 0.8, 1.0)  # noqa: PLW2901 - of what follows
        how: dict[str, Any] = {
            "latitude": lat, "longitude": lon, "region": area, "radius_m": radius,
            "force": force, "choose_pole": choose_pole, "progress": tell,
        }  # fmt: skip
        inputs = found.inputs if found else ()
        if streets is not None:
            path = init_site_of_map(target, streets, osm=extract, **how)
        elif chosen_place is not None and extract is not None:
            path = init_preset_site(
                target, extract, chosen_place, at_junction=at_junction, fetched=inputs,
                **how,
            )  # fmt: skip
        elif extract is not None:
            path = init_site(target, extract, fetched=inputs, **how)
    told = [warning for pole in chosen for warning in warnings_of_place(pole)]
    tell_result("init", target, [*(found.warnings if found else ()), *told], progress)
    return Site(path, found.rows if found else ())


def _check_choice(
    options: FetchOptions,
    preset: Preset | None,
    extract: Path | None,
    streets: Path | None,
    lat: float | None,
    lon: float | None,
    *,
    at_junction: bool,
) -> None:
    """Check that the options for map and place are compatible.

    Raises:
        InputError: they are not, or no map is given.
    """
    from urbantwin.site.presets.preset_site import needs_extract

    if preset is not None and streets is not None:
        raise InputError(
            "is given with a map of the roads", place="--preset", expected="an extract (--osm)"
        )
    options.check_alone(roads=streets, lat=lat, lon=lon, at_junction=at_junction)
    if extract is None and streets is None and not options.is_asked:
        if preset is not None:
            raise needs_extract(preset)
        raise InputError(
            "no map is given",
            place="--osm",
            expected="--osm or --roads with a file, or --at LAT,LON to fetch one",
        )
    if (lat is None) != (lon is None):
        given, lacking = ("--lat", "--lon") if lon is None else ("--lon", "--lat")
        raise InputError("is alone", place=given, expected=f"{lacking} beside it")
    if at_junction and lat is not None:
        raise InputError(
            "is given with coordinates", place="--at-junction", expected="one of the two"
        )


def _map_first(
    file: Path, folder: Path, osm: Path | None, roads: Path | None
) -> tuple[Path, Path | None, Path | None]:
    """Return folder, extract and road map, if the first argument is a map."""
    from urbantwin.roads.imported import is_map_of_roads

    if is_map_of_roads(file):
        if roads is not None:
            raise InputError("is a second map of the roads", file=file, expected="one of the two")
        return folder, osm, file
    if osm is not None:
        raise InputError("is a second extract", file=file, expected="one of the two")
    return folder, file, roads
