"""Acquisition of all inputs of a place, by kind, from the finest source that has data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from pyproj import CRS

from urbantwin.acquire.area import Area, may_be_swapped, swapped_hint
from urbantwin.acquire.copc import fetch_copc
from urbantwin.acquire.elevation import fetch_cog, fetch_geotiff, fetch_terrain_tiles
from urbantwin.acquire.entwine import fetch_ept
from urbantwin.acquire.map_pictures import fetch_pictures, name_tileset
from urbantwin.acquire.overpass import fetch_map
from urbantwin.acquire.overture import fetch_footprints
from urbantwin.acquire.source import AcquiredInput, Fetch, ListedSource, Source
from urbantwin.acquire.source_table import KINDS, Kind, SourceSpec
from urbantwin.acquire.web import NoKeyError, NotAcquiredError, NothingThereError, Web
from urbantwin.artefact import sha256_of
from urbantwin.download import DownloadError
from urbantwin.errors import InputError, readable
from urbantwin.progress import Progress, between, untold
from urbantwin.reconstruct.georeference.height_system import HeightSystem
from urbantwin.result_warning import ResultWarning
from urbantwin.site.extract_coverage import check_roads
from urbantwin.site.extract_file import NO_NODES, read_extract
from urbantwin.site.fetched import FetchedInput, FetchedSpec

__all__ = ["Acquired", "Attempt", "acquire_inputs", "check_streets", "sources_of"]

#: Outcome of a kind whose sources the user excluded.
NOT_ASKED = "not asked"

_HOW: Mapping[str, Fetch] = {
    "overpass": fetch_map,
    "cog": fetch_cog,
    "geotiff": fetch_geotiff,
    "terrarium": fetch_terrain_tiles,
    "copc": fetch_copc,
    "ept": fetch_ept,
    "geoparquet": fetch_footprints,
    "xyz": fetch_pictures,
    "tileset": name_tileset,
}
#: Kinds in words.
_WORDS: Mapping[Kind, str] = {
    "map": "the map",
    "elevation": "elevation",
    "airborne": "airborne LiDAR",
    "buildings": "footprints of buildings",
    "imagery": "imagery",
    "tiles": "3D Tiles",
}


@dataclass(frozen=True)
class Attempt:
    """Outcome of a source, or of a kind without a source.

    Attributes:
        kind: kind of input.
        source: name of the source; empty if none covers the place.
        outcome: ``fetched``, ``not used``, ``failed``, ``nothing there``, ``no key``,
            ``no source``, or ``not asked`` if the user excluded all sources of the kind.
        told: content, or reason of the failure.
    """

    kind: Kind
    source: str
    outcome: str
    told: str = ""

    def row(self) -> dict[str, str]:
        """Return the attempt as a row of a table, without empty fields."""
        row = {"kind": str(self.kind), "source": self.source, "outcome": self.outcome}
        return {name: text for name, text in (row | {"told": self.told}).items() if text}


@dataclass(frozen=True)
class Acquired:
    """Acquired inputs of a place.

    Attributes:
        inputs: at most one of each kind, in the order of kinds.
        attempts: every requested source, and every kind without a source.
        warnings: warnings for the user.
    """

    inputs: tuple[AcquiredInput, ...]
    attempts: tuple[Attempt, ...]
    warnings: tuple[ResultWarning, ...] = field(default=())

    def noted(self) -> list[FetchedInput]:
        """Return the inputs as named in ``site.yaml``."""
        return [_noted(one) for one in self.inputs]


def sources_of(specs: Sequence[SourceSpec]) -> list[Source]:
    """Return the sources of rows of the table, except sources of place names."""
    return [ListedSource(one, _HOW[one.access]) for one in specs if one.access in _HOW]


def acquire_inputs(
    area: Area,
    folder: Path,
    sources: Sequence[Source],
    web: Web,
    *,
    without: Sequence[Kind] = (),
    progress: Progress = untold,
) -> Acquired:
    """Fetch the inputs of an area from sources.

    For each kind, the sources that cover the area are tried in the order given, until one has data.
    Only the map is required.

    Args:
        area: the place.
        folder: folder of the written files.
        sources: permitted sources.
        web: access to servers.
        without: kinds to skip.
        progress: called with the share done (0..1) and the current task.

    Raises:
        InputError: no map, no street in the area, or a key may not be sent to its source.
    """
    inputs: list[AcquiredInput] = []
    attempts: list[Attempt] = []
    kinds = [one for one in KINDS if one not in without]
    for one in sources:  # check keys before fetching
        if one.spec.kind in kinds and one.covers(area):
            with suppress(NoKeyError):
                web.key_of(one.spec)
    # Kinds without any offered source were excluded by the user; tiles and the map are handled
    # separately.
    offered = {"map", "tiles", *(one.spec.kind for one in sources)}
    for number, kind in enumerate(kinds):
        tell = between(progress, number / len(kinds), (number + 1) / len(kinds))
        tell(0.0, _WORDS[kind])
        those = [one for one in sources if one.spec.kind == kind and one.covers(area)]
        found, asked = _first(those, area, web, folder, tell)
        attempts += asked
        if kind not in offered:
            attempts.append(Attempt(kind, "", NOT_ASKED))
        elif not those and kind != "tiles":  # tiles are optional
            attempts.append(Attempt(kind, "", "no source", "no source covers the place"))
        if kind == "map":
            if found is None:
                raise _no_map(asked, web)
            check_streets(found.path or folder, area)
        if found is not None:
            inputs.append(found)
    _keep_one_datum(inputs, attempts)
    cautions = [
        ResultWarning(one.source.name, one.source.caution) for one in inputs if one.source.caution
    ]
    warnings = (*web.warnings, *_warnings(attempts), *cautions)
    return Acquired(tuple(inputs), tuple(attempts), warnings)


def check_streets(path: Path, area: Area) -> None:
    """Check that a map has streets in an area.

    Raises:
        InputError: it has none there, or is not a map.
    """
    here = f"{area.latitude:g},{area.longitude:g}"
    try:
        extract = read_extract(path)
        if extract.highways():
            check_roads(extract, area.frame, area.circle, "the region")
            return
        problem = "nothing is mapped there that is driven on"
    except InputError as error:
        problem = error.problem
        if problem == NO_NODES:
            problem = "the map has nothing there"
    swapped = ""
    if may_be_swapped(area.latitude, area.longitude):
        swapped = f"; or {swapped_hint(area.latitude, area.longitude)}"
    raise InputError(
        f"there is no street within {area.radius_m:g} m of {here}: {problem}",
        place="--at",
        expected=f"a place at a street, or a larger --radius{swapped}",
    )


def _first(
    sources: Sequence[Source], area: Area, web: Web, folder: Path, progress: Progress
) -> tuple[AcquiredInput | None, list[Attempt]]:
    """Return the input of the first source with data, and the attempts made."""
    asked: list[Attempt] = []
    for one in sources:
        name, kind = one.spec.name, one.spec.kind
        try:
            found = one.fetch(area, web, folder, progress)
            _check_keyless(found, web)
        except (NotAcquiredError, DownloadError) as error:
            told = web.secrets.hidden(readable(str(error)))
            gone = isinstance(error, DownloadError) and error.status in (404, 410)
            outcome = "failed"
            if isinstance(error, NoKeyError):
                outcome = "no key"
            elif gone or isinstance(error, NothingThereError):
                outcome, told = "nothing there", ""
            asked.append(Attempt(kind, name, outcome, told))
        else:
            asked.append(Attempt(kind, name, "fetched", found.told))
            return found, asked
    return None, asked


def _keep_one_datum(inputs: list[AcquiredInput], attempts: list[Attempt]) -> None:
    """Drop elevation whose vertical datum cannot be compared with that of the airborne survey.

    Converting between vertical datums needs PROJ grids, which few machines have; the build would
    fail. The survey contains the ground as well.
    """
    by_kind = {one.kind: one for one in inputs}
    survey, model = by_kind.get("airborne"), by_kind.get("elevation")
    if survey is None or model is None:
        return
    a, b = (HeightSystem.of(CRS(one.crs)) for one in (survey, model))
    if a is not None and b is not None and a.same_datum(b):
        return
    inputs.remove(model)
    names = [one.name if one else "a datum that is not stated" for one in (b, a)]
    told = f"its heights are above {names[0]}, those of {survey.source.name} above {names[1]}"
    at = next(k for k, one in enumerate(attempts) if one.source == model.source.name)
    attempts[at] = Attempt("elevation", model.source.name, "not used", told)


def _check_keyless(found: AcquiredInput, web: Web) -> None:
    """Check that the server did not write a key into a file, which may be shared later.

    Raises:
        NotAcquiredError: the file contains a key.
    """
    if found.path is not None and web.secrets.held_by(found.path.read_bytes()):
        found.path.unlink()
        raise NotAcquiredError("is refused: the answer contains the key")


def _noted(one: AcquiredInput) -> FetchedInput:
    fetched = None
    if one.path is not None:
        fetched = FetchedSpec(
            source=one.source.name, url=one.url, at=one.at, sha256=sha256_of(one.path)
        )
    return FetchedInput(
        one.kind,
        one.path,
        one.source.licence,
        one.source.attribution,
        fetched,
        dict(one.fields),
        one.source.caution or "",
    )


def _no_map(asked: Sequence[Attempt], web: Web) -> InputError:
    reasons = "; ".join(f"{one.source}: {one.told or one.outcome}" for one in asked)
    expected = (
        "an answer in the cache (--cache DIR), or a network and no --offline, or --osm FILE"
        if web.offline
        else "a network, --offline with what a cache holds, or --osm FILE"
    )
    return InputError(
        f"the map cannot be fetched ({reasons or 'no source of maps is enabled'})",
        place="--at",
        expected=expected,
    )


def _warnings(attempts: Sequence[Attempt]) -> list[ResultWarning]:
    """Return warnings of failures and of kinds without data."""
    had = {one.kind for one in attempts if one.outcome in ("fetched", "not used", NOT_ASKED)}
    found = [
        ResultWarning(one.source, f"{_WORDS[one.kind]} could not be fetched", one.told)
        for one in attempts
        if one.outcome == "failed"
    ] + [
        ResultWarning(one.source, "is not used beside the survey, which has the ground", one.told)
        for one in attempts
        if one.outcome == "not used"
    ]
    return found + [
        ResultWarning(_WORDS[kind], "none was found for this place")
        for kind in dict.fromkeys(one.kind for one in attempts)
        if kind not in had and kind not in ("tiles", "map")
    ]
