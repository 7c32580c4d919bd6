"""All findings about a site's inputs, by weight."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import osmium
import osmium.osm

from urbantwin.progress import Progress, between, untold
from urbantwin.site import Extract, Site, box_around, read_extract
from urbantwin.site.building_file import read_buildings, with_buildings
from urbantwin.site.corrections import read_corrections, with_elements
from urbantwin.site.extract_coverage import check_roads
from urbantwin.weakness.finding import Finding, finding
from urbantwin.weakness.inputs import extract_findings, input_findings
from urbantwin.weakness.junctions import junction_findings
from urbantwin.weakness.map_findings import (
    building_findings,
    furniture_findings,
    street_findings,
    walking_findings,
)
from urbantwin.weakness.mapped_site import MappedSite

__all__ = ["InputCheck", "check_inputs", "map_date"]

#: Keys of a file's header with the date of its data.
_DATE_KEYS = ("osmosis_replication_timestamp", "timestamp")
#: Size above which files are not read again for the times of their elements, bytes.
_MAX_REREAD_BYTES = 30_000_000


def map_date(path: Path) -> datetime | None:
    """Return the date of an extract: from its header, else of its newest element.

    Args:
        path: an extract that was read successfully.

    Returns:
        ``None`` if it is unknown, or the file is large and its header has no date.
    """
    with osmium.io.Reader(str(path)) as reader:
        header = reader.header()
        for key in _DATE_KEYS:
            date_text = header.get(key)
            if date_text:
                try:
                    date = datetime.fromisoformat(date_text)
                except ValueError:
                    continue
                return date if date.tzinfo else date.replace(tzinfo=UTC)
    if path.stat().st_size > _MAX_REREAD_BYTES:
        return None
    newest = None
    for item in osmium.FileProcessor(str(path)):
        if isinstance(item, osmium.osm.OSMObject):
            time = item.timestamp
            newest = time if newest is None else max(newest, time)
    # Files without times have those of 1970.
    return newest if newest is not None and newest.year > 2003 else None


@dataclass(frozen=True, eq=False)
class InputCheck:
    """The weak points of a site's inputs.

    Attributes:
        site: the site as written.
        findings: the findings, those with the largest weight first.
        map_date: date of the map, if known.
        place: the site with its map, for pictures; ``None`` without a map.
    """

    site: Site
    findings: tuple[Finding, ...]
    map_date: datetime | None
    place: MappedSite | None

    @property
    def attribution(self) -> str:
        """Attribution of the streets and buildings that its plan shows."""
        shown = [
            source.attribution
            for source in (self.site.osm, self.site.buildings)
            if source is not None
        ]
        return "; ".join(dict.fromkeys(shown))

    def as_json(self) -> dict[str, Any]:
        """Return it for JSON."""
        counts = dict.fromkeys(("much", "some", "little"), 0)
        for item in self.findings:
            counts[item.matters] += 1
        return {
            "kind": "input check",
            "name": self.site.name,
            "anchor": {"latitude": self.site.latitude, "longitude": self.site.longitude},
            "map_date": None if self.map_date is None else self.map_date.date().isoformat(),
            "matters": counts,
            "findings": [item.as_json(k) for k, item in enumerate(self.findings, 1)],
        }


def check_inputs(site: Site, *, progress: Progress | None = None) -> InputCheck:
    """Check the inputs of a site, without building it.

    The map is read as for a build: with the heights and footprints of the site's file of buildings,
    and with corrected tags. Of the geometry and of a map of the roads only the names are used.

    Args:
        site: the site as written.
        progress: called with the fraction done (0..1) and the current task.

    Raises:
        InputError: an input cannot be read, or the map has no road in the region.
    """
    tell = progress or untold
    findings: list[Finding] = []
    place, date = None, None
    if site.osm is not None:
        bounds = box_around(site.frame, site.region)
        extract = read_extract(site.osm.path, bounds, progress=between(tell, 0.0, 0.5))
        check_roads(extract, site.frame, site.region, "the region")
        tell(0.5, "looking for what is weak")
        date = map_date(site.osm.path)
        place = _mapped(site, extract)
        findings += [*extract_findings(place), *building_findings(place)]
        findings += [*furniture_findings(place), *walking_findings(place)]
        if site.roads is None:
            findings += [*street_findings(place), *junction_findings(place)]
    elif site.sketch is None:
        findings.append(finding("no-map", "there is no OpenStreetMap extract", where="osm"))
    tell(0.9, "looking at the other inputs")
    findings += input_findings(site, date)
    order = sorted(findings, key=lambda item: (-round(item.weight, 6), item.kind, item.where))
    tell(1.0, "done")
    return InputCheck(site, tuple(order), date, place)


def _mapped(site: Site, extract: Extract) -> MappedSite:
    """Return the map with the site's buildings and corrections.

    Raises:
        InputError: a file is wrong, or corrects an element that the map does not have.
    """
    whole, corrections = extract, []
    if site.buildings is not None:
        footprints = read_buildings(site.buildings.path)
        whole, _ = with_buildings(whole, footprints, site.frame, site.region)
    added = (whole.ways.keys() | whole.relations.keys()) - (
        extract.ways.keys() | extract.relations.keys()
    )
    if site.corrections is not None:
        corrections = read_corrections(site.corrections.path, site.frame, site.region)
        whole, _ = with_elements(whole, corrections, site.frame, site.region)
    return MappedSite(site, whole, frozenset(added), tuple(corrections))
