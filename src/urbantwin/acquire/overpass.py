"""OpenStreetMap by the Overpass API: the map around a place, and other queries.

Query language: https://wiki.openstreetmap.org/wiki/Overpass_API/Overpass_QL. A server that gives up
during a query responds with status 200 and a remark, which is checked for.
"""

from __future__ import annotations

import re
from pathlib import Path
from urllib.parse import urlencode

from urbantwin.acquire.area import Area
from urbantwin.acquire.source import AcquiredInput
from urbantwin.acquire.source_table import SourceSpec
from urbantwin.acquire.web import Fetched, NotAcquiredError, Server, Web
from urbantwin.download import DownloadError
from urbantwin.errors import readable
from urbantwin.geometry import SiteFrame
from urbantwin.progress import Progress
from urbantwin.site.extract_file import LonLatBox, box_around
from urbantwin.site.region import circle

__all__ = ["fetch_map", "overpass_answer"]

#: Time limit of a query, seconds, and memory limit, bytes.
_TIME_S, _MEMORY = 90, 128 << 20
#: Query of a map: ways in the box with all their nodes, nodes in the box, and relations; members
#: outside of the box only for buildings, which must be complete.
_MAP = """[out:xml][timeout:{time}][maxsize:{memory}];
way({box})->.near;
rel({box})->.groups;
rel.groups[building]->.built;
way(r.built)->.parts;
(node({box}); node(w.near); node(w.parts); .near; .parts; .groups;);
out body;
"""


def fetch_map(
    spec: SourceSpec, area: Area, web: Web, folder: Path, progress: Progress
) -> AcquiredInput:
    """Write the map around an area, with a margin so that no way is cut within the area."""
    box = box_around(SiteFrame(area.latitude, area.longitude), circle(area.radius_m))
    south_west = f"{box[1]:.5f},{box[0]:.5f},{box[3]:.5f},{box[2]:.5f}"
    query = _MAP.format(box=south_west, time=_TIME_S, memory=_MEMORY)
    server, told_by, told = overpass_answer(spec, query, web, b"osm", progress)
    path = folder / "map.osm"
    path.write_bytes(_with_bounds(told.data, box))
    return AcquiredInput("map", spec, path, server.shown(told_by), told.at)


def overpass_answer(
    spec: SourceSpec, query: str, web: Web, kind: bytes, progress: Progress
) -> tuple[Server, str, Fetched]:
    """Return the first server that responds to a query, its address, and the response.

    Args:
        spec: the source, with its mirrors.
        query: query in Overpass QL.
        web: access to servers.
        kind: ``osm`` for a response in XML, ``json`` for JSON.
        progress: called with the fraction done and the server's name.

    Raises:
        NotAcquiredError: no server gives a valid response.
    """
    problems: dict[str, list[str]] = {}
    for number, address in enumerate((spec.address, *spec.mirrors)):
        server = web.server(spec, address)
        host = server.shown(address).split("/")[2]
        progress(number / (1 + len(spec.mirrors)), f"asking {host}")
        request = f"{address}?{urlencode({'data': query})}"
        try:
            told = server.get(request)
            _check_answer(told.data, kind)
        except DownloadError as error:
            problems.setdefault(str(error), []).append(host)
        except NotAcquiredError as error:
            web.cache.forget(request)
            problems.setdefault(str(error), []).append(host)
        else:
            return server, address, told
    told_by = [f"{', '.join(hosts)}: {problem}" for problem, hosts in problems.items()]
    raise NotAcquiredError("; ".join(told_by))


def _check_answer(data: bytes, kind: bytes) -> None:
    """Check that a response is complete.

    Raises:
        NotAcquiredError: not OpenStreetMap data, incomplete, or the server gave up.
    """
    head = data[:2000].lstrip()
    begins = head.startswith(b"{") if kind == b"json" else b"<osm" in head
    if not begins:
        raise NotAcquiredError("the answer is not of OpenStreetMap")
    remark = re.search(
        rb"<remark>\s*(.*?error.*?)\s*</remark>|\"remark\":\s*\"(.*?error.*?)\"", data, re.DOTALL
    )
    if remark:
        text = (remark[1] or remark[2]).decode(errors="replace")
        raise NotAcquiredError(f"the server gave up ({readable(text, 100)})")
    if not data.rstrip().endswith(b"}" if kind == b"json" else b"</osm>"):
        raise NotAcquiredError("the answer ends early")


def _with_bounds(data: bytes, box: LonLatBox) -> bytes:
    """Return a map with its bounding box added."""
    if b"<bounds" in data[:4000]:
        return data
    west, south, east, north = box
    bounds = (
        f'\n  <bounds minlat="{south:.7f}" minlon="{west:.7f}" '
        f'maxlat="{north:.7f}" maxlon="{east:.7f}"/>'
    )
    at = data.index(b">", data.index(b"<osm")) + 1
    return data[:at] + bounds.encode() + data[at:]
