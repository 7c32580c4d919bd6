"""A first ``site.yaml`` for a place at which a dataset was recorded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from pyproj import Geod

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.progress import Progress, between, untold
from urbantwin.site.draft import SiteDraft
from urbantwin.site.extract_file import box_around, read_extract
from urbantwin.site.fetched import FetchedInput
from urbantwin.site.initial_site import init_site
from urbantwin.site.pole_site import PoleChoice, PoleGround, nearest_place
from urbantwin.site.presets.mix import per_hour_of_presence
from urbantwin.site.presets.preset import Preset
from urbantwin.site.presets.proposed_poles import stand_of_sensors
from urbantwin.site.presets.rig_text import rig_text
from urbantwin.site.presets.street_corner import street_corner
from urbantwin.site.region import FARTHEST_ANCHOR_M, circle

__all__ = [
    "check_place",
    "init_preset_site",
    "needs_extract",
    "place_of_preset",
    "where_extracts_are",
]


def init_preset_site(  # noqa: PLR0913 - every one is a person's choice
    folder: Path,
    osm: Path,
    preset: Preset,
    *,
    latitude: float | None = None,
    longitude: float | None = None,
    at_junction: bool = False,
    region: Path | None = None,
    radius_m: float | None = None,
    force: bool = False,
    choose_pole: PoleChoice = nearest_place,
    fetched: Sequence[FetchedInput] = (),
    progress: Progress | None = None,
) -> Path:
    """Write the ``site.yaml`` of a preset for an OpenStreetMap extract and return its path.

    Sensors whose place is published stand there; poles of the others are proposed.

    Args:
        folder: where to write; made if it is not there.
        osm: the extract.
        preset: which place.
        latitude: of the anchor, instead of the preset's.
        longitude: of the anchor, instead of the preset's.
        at_junction: take the busiest signalised junction of the map instead of the preset's place.
        region: a GeoJSON polygon, instead of the preset's circle.
        radius_m: of a circle, instead of the preset's.
        force: replace a ``site.yaml`` that is there.
        choose_pole: where a sensor of unknown place stands on the ground of the junction.
        fetched: inputs that were fetched for the place, the extract among them.
        progress: called with the share done (0..1) and the current task.

    Raises:
        InputError: the place is not published and none is given, or as `init_site`.
    """
    tell = progress or untold
    why = "As given."
    check_place(preset, latitude, longitude, at_junction=at_junction)
    if latitude is None and not at_junction:
        latitude, longitude, why = place_of_preset(preset, osm, progress=between(tell, 0.0, 0.4))

    def furnished(draft: SiteDraft, ground: PoleGround) -> SiteDraft:
        return _furnished(draft, ground, preset, why if latitude is not None else draft.why,
                          choose_pole)  # fmt: skip

    radius = preset.region.radius_m if radius_m is None and region is None else radius_m
    return init_site(
        folder,
        osm,
        latitude=latitude,
        longitude=longitude,
        region=region,
        radius_m=radius,
        force=force,
        choose_pole=nearest_place,
        furnish=furnished,
        fetched=fetched,
        progress=between(tell, 0.4, 1.0),
    )


def check_place(
    preset: Preset, latitude: float | None, longitude: float | None, *, at_junction: bool = False
) -> None:
    """Check that a person's place is that of the preset, if that is published.

    Raises:
        InputError: it is another one.
    """
    place = preset.place
    if place is None:
        return
    expected = f"a place around {place.latitude:.5f}, {place.longitude:.5f}, or none"
    if at_junction:
        problem = "is given with a preset of which the place is known"
        raise InputError(problem, place="--at-junction", expected=expected)
    if latitude is not None and longitude is not None:
        ends = (place.longitude, place.latitude, longitude, latitude)
        away = float(Geod(ellps="WGS84").inv(*ends)[2])
        if away > place.within_m + FARTHEST_ANCHOR_M:
            shown = f"{away / 1000:.0f} km" if away >= 10_000 else f"{away:.0f} m"
            problem = f"is of a place {shown} from {latitude:g}, {longitude:g}"
            raise InputError(problem, place=f"--preset {preset.name}", expected=expected)


def place_of_preset(
    preset: Preset, osm: Path, *, progress: Progress | None = None
) -> tuple[float, float, str]:
    """Return latitude and longitude of a preset's anchor on a map, and why it is there.

    Raises:
        InputError: the place is not published.
    """
    place = preset.place
    if place is None:
        raise InputError(
            "is of a place that nobody published",
            place=f"--preset {preset.name}",
            expected="--lat and --lon of a junction that you choose, or --at-junction",
        )
    if place.streets:
        site = SiteFrame(place.latitude, place.longitude)
        near = box_around(site, circle(place.within_m))
        extract = read_extract(osm, near, progress=progress)
        corner = street_corner(extract, site, place.streets, place.within_m)
        names = " and ".join(one[0] for one in place.streets)
        if corner is not None:
            return *corner, f"Where {names} meet on the map."
        why = (
            f"The map does not tell where {names} meet: it is within {place.within_m:g} m of here."
        )
        return place.latitude, place.longitude, why
    why = f"Within {place.within_m:g} m of the true place, by the sources above."
    return place.latitude, place.longitude, why


def needs_extract(preset: Preset) -> InputError:
    """Return what to tell who gave a preset without a map."""
    return InputError(
        "needs a map of the place",
        place=f"--preset {preset.name}",
        expected=f"--at LAT,LON of a junction to fetch one, or {where_extracts_are(preset)}",
    )


def where_extracts_are(preset: Preset) -> str:
    """Return the option that takes an extract of a preset's place, and where to get one."""
    place = preset.place
    get = "its own junction's: https://www.openstreetmap.org/export"
    if place is not None:
        site = SiteFrame(place.latitude, place.longitude)
        box = ",".join(f"{value:.4f}" for value in box_around(site, circle(20.0)))
        get = (
            f"https://www.openstreetmap.org/export#map=17/{place.latitude:.5f}/"
            f"{place.longitude:.5f}, or `osmium extract -b {box} COUNTRY.osm.pbf -o map.osm.pbf`"
        )
    return f"--osm with an extract: {get}"


def _furnished(
    draft: SiteDraft, ground: PoleGround, preset: Preset, why: str, choose_pole: PoleChoice
) -> SiteDraft:
    site = SiteFrame(draft.latitude, draft.longitude)
    per_hour, remark = dict(draft.per_hour), ""
    traffic = preset.traffic
    if traffic is not None and traffic.per_hour is not None:
        per_hour, remark = dict(traffic.per_hour), traffic.sources["per_hour"]
    elif traffic is not None and traffic.boxes_per_frame is not None:
        per_hour = per_hour_of_presence(traffic.boxes_per_frame, per_hour)
        remark = (
            "The map's guess of all motor vehicles, shared out as seen in the recording: "
            + traffic.sources["boxes_per_frame"]
        )
    stands = stand_of_sensors(preset, ground, site, choose_pole)
    return replace(
        draft,
        title=preset.title,
        why=why,
        per_hour=per_hour,
        about=_about(preset),
        traffic_remark=remark,
        guessed=traffic is None or traffic.per_hour is None,
        rig=rig_text(preset, stands),
    )


def _about(preset: Preset) -> Sequence[str]:
    """Return what the file says of the recording, its sources and what nobody published."""
    lines = [
        f"The place of {preset.recording} ({preset.homepage}).",
        f"Nothing of the recording is here; its licence is {preset.licence}.",
        "",
        "Sources:",
    ]
    sections = (
        ("place", preset.place),
        ("region", preset.region),
        ("frame of the poses", preset.frame),
        ("timing", preset.timing),
    )
    for title, section in sections:
        if section is not None:
            lines += [f"- {title}: {names}: {text}" for names, text in section.sources.items()]
    lines += ["", "Unknown:", *(f"- {text}" for text in preset.unknown)]
    return tuple(lines)
