"""Bad answers of servers that a site's inputs are fetched from."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest

from urbantwin.acquire import (
    AnswerCache,
    Area,
    NotAcquiredError,
    SourceSpec,
    Web,
    find_place,
    sources_of,
)
from urbantwin.acquire.source_table import read_sources
from urbantwin.download import Answer, DownloadError
from urbantwin.errors import InputError
from urbantwin.site import read_extract
from urbantwin.site.building_file import read_buildings, with_buildings

from ..acquire import made_world
from ..acquire.local_web import known_place
from ..acquire.octree_files import as_copc, as_ept
from .harness import NUMBERS
from .reader import Reader

AREA = Area.checked(made_world.LATITUDE, made_world.LONGITUDE, 60.0)
ROW = {"name": "made", "title": "made", "licence": "made", "attribution": "made"}
EPT = {"kind": "airborne", "access": "ept", "url": "http://127.0.0.1/ept.json"}


class Folder:
    """What answers in a server's place: the files of a folder, in ranges too."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def fetch(self, address: str, span: tuple[int, int] | None) -> Answer:
        try:
            data = (self.folder / urlsplit(address).path.lstrip("/")).read_bytes()
        except (OSError, ValueError):
            raise DownloadError("not found (404)", status=404) from None
        first, stop = span or (0, len(data))
        return Answer(data[first:stop], first, len(data), "1")


def answered(folder: Path) -> Web:
    """A web whose servers are a folder."""
    web = Web(AnswerCache(folder / "cache"), environment={})
    server = web.server

    def here(*arguments: Any) -> Any:
        made = server(*arguments)
        secrets = made._client.secrets
        made._client = SimpleNamespace(fetch=Folder(folder).fetch, secrets=secrets)
        return made

    web.server = here
    return web


def fetched(**row: Any) -> Callable[[Path], None]:
    """What a source does with the files of a folder."""

    def read(path: Path) -> None:
        out = path.parent / "out"
        out.mkdir(exist_ok=True)
        (source,) = sources_of([SourceSpec.model_validate(ROW | row)])
        try:
            source.fetch(AREA, answered(path.parent), out, lambda *_: None)
        except (NotAcquiredError, DownloadError) as error:
            raise InputError(str(error)) from None
        finally:
            shutil.rmtree(out)
            shutil.rmtree(path.parent / "cache", ignore_errors=True)

    return read


def read_outlines(path: Path) -> None:
    extract = read_extract(made_world.EXTRACT)
    with_buildings(extract, read_buildings(path), AREA.frame, AREA.circle)


def read_names(path: Path) -> None:
    rows = [
        {"kind": "names", "access": "nominatim", "url": "http://127.0.0.1/names.json"},
        {"kind": "map", "access": "overpass", "url": "http://127.0.0.1/meet.json"},
    ]
    specs = [SourceSpec.model_validate(ROW | row) for row in rows]
    try:
        find_place("Long Avenue and Cross Street, Stuttgart", specs, answered(path.parent))
    finally:
        shutil.rmtree(path.parent / "cache", ignore_errors=True)


def _survey() -> tuple[np.ndarray, np.ndarray]:
    return made_world.survey(60.0, 20.0)


def _footprints() -> list[bytes]:
    features = [
        {"type": "Feature", "properties": {"building": "yes", "height": 7.5, "roof:shape": "flat"},
         "geometry": {"type": "Polygon", "coordinates":
                      [list(map(list, made_world.footprint(30.0 * k, 40.0).exterior.coords))]}}
        for k in range(2)
    ]  # fmt: skip
    return [json.dumps({"type": "FeatureCollection", "features": features}).encode()]


def _parquet() -> list[bytes]:
    return [made_world.parquet([made_world.footprint(0, 10.0 * k) for k in range(3)], [3.0] * 3)]


def _cog() -> list[bytes]:
    return [made_world.cog(9.17, 48.69, 0.02, 64)]


def _ept(name: str) -> Callable[[], list[bytes]]:
    return lambda: [as_ept(*_survey(), made_world.RD)[name]]


def _names() -> list[bytes]:
    return [json.dumps([known_place(48.7, 9.18, "Stuttgart")]).encode()]


def _meet() -> bytes:
    node = {"type": "node", "id": 1, "lat": 48.7, "lon": 9.18}
    return json.dumps({"version": 0.6, "elements": [node]}).encode()


def _table() -> list[bytes]:
    path = Path(made_world.ROOT / "src" / "urbantwin" / "acquire" / "sources.yaml")
    parts = path.read_bytes().split(b"\n\n")
    return [parts[0] + b"\n" + b"\n\n".join(parts[2:4])]


READERS = [
    Reader("fetched names", read_names, "names.json", _names, lambda: {"meet.json": _meet()}),
    Reader("fetched meetings", read_names, "meet.json", lambda: [_meet()],
           lambda: {"names.json": _names()[0]}),
    Reader("fetched cog", fetched(kind="elevation", access="cog", url="http://127.0.0.1/a.tif"),
           "a.tif", _cog),
    Reader("fetched geotiff",
           fetched(kind="elevation", access="geotiff", url="http://127.0.0.1/a.tif"), "a.tif",
           _cog),
    Reader("fetched copc", fetched(kind="airborne", access="copc", url="http://127.0.0.1/a.laz"),
           "a.laz", lambda: [as_copc(*_survey(), made_world.RD)]),
    Reader("fetched ept", fetched(**EPT), "ept.json", _ept("ept.json"),
           lambda: as_ept(*_survey(), made_world.RD)),
    Reader("fetched ept hierarchy", fetched(**EPT), "ept-hierarchy/0-0-0-0.json",
           _ept("ept-hierarchy/0-0-0-0.json"), lambda: as_ept(*_survey(), made_world.RD)),
    Reader("fetched parquet",
           fetched(kind="buildings", access="geoparquet", url="http://127.0.0.1/a.parquet"),
           "a.parquet", _parquet),
    Reader("buildings", read_outlines, "buildings.geojson", _footprints),
    Reader("sources", read_sources, "own.yaml", _table),
]  # fmt: skip


@pytest.mark.parametrize("mutations", NUMBERS)
@pytest.mark.parametrize("reader", READERS, ids=str)
def test_bad_files(reader: Reader, mutations: int, fuzz: Callable[[Reader, int], None]) -> None:
    fuzz(reader, mutations)
