"""Servers on this machine that speak what public ones do: ranges, Overpass, Nominatim, faults."""

import contextlib
import hashlib
import json
import math
import re
import threading
from collections.abc import Callable, Iterator
from email.message import Message
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs, urlsplit
from xml.etree import ElementTree

Handler = BaseHTTPRequestHandler


class Web:
    """One server.

    Attributes:
        files: contents by path; served whole or in ranges, with an ETag.
        answers: what answers for a path in place of a file: called with the handler.
        faults: what answers the next requests of a path instead, one each.
        asked: every request: path with query, and headers.
    """

    def __init__(self) -> None:
        self.files: dict[str, bytes] = {}
        self.answers: dict[str, Callable[[Handler], None]] = {}
        self.faults: dict[str, list[Callable[[Handler], None]]] = {}
        self.asked: list[tuple[str, Message]] = []
        web = self

        class Asked(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def log_message(self, *_: object) -> None:
                pass

            def do_GET(self) -> None:
                web.asked.append((self.path, self.headers))
                path = urlsplit(self.path).path
                with contextlib.suppress(ConnectionError):
                    if web.faults.get(path):
                        web.faults[path].pop(0)(self)
                    elif path in web.answers:
                        web.answers[path](self)
                    elif path in web.files:
                        send_file(self, web.files[path])
                    else:
                        send(self, b"gone", status=404)

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Asked)
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.02,))
        self._thread.start()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self._server.server_address[1]}"

    def paths(self) -> list[str]:
        return [urlsplit(path).path for path, _ in self.asked]

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join(10)


@contextlib.contextmanager
def serving() -> Iterator[Web]:
    web = Web()
    try:
        yield web
    finally:
        web.close()


def send(handler: Handler, body: bytes, *headers: tuple[str, str], status: int = 200) -> None:
    handler.send_response(status)
    handler.send_header("Content-Length", str(len(body)))
    for name, value in headers:
        handler.send_header(name, value)
    handler.end_headers()
    handler.wfile.write(body)


def send_file(handler: Handler, data: bytes) -> None:
    """As RFC 9110 has it: a range is 206 with Content-Range, or 416."""
    tag = ("ETag", f'"{hashlib.sha256(data).hexdigest()[:16]}"')
    told = re.fullmatch(r"bytes=(\d+)-(\d+)", handler.headers.get("Range", ""))
    if told is None:
        send(handler, data, tag)
        return
    first, last = int(told[1]), min(int(told[2]), len(data) - 1)
    if first > last:
        send(handler, b"", ("Content-Range", f"bytes */{len(data)}"), status=416)
        return
    where = ("Content-Range", f"bytes {first}-{last}/{len(data)}")
    send(handler, data[first : last + 1], tag, where, status=206)


def overpass(extract: bytes) -> Callable[[Handler], None]:
    """What Overpass answers of an extract: to the map of a box, and to where two streets meet."""
    root = ElementTree.fromstring(extract)
    nodes = {node.get("id"): node for node in root.iter("node")}
    ways = list(root.iter("way"))

    def tags(one: ElementTree.Element) -> dict[str, str]:
        return {tag.get("k", ""): tag.get("v", "") for tag in one.iter("tag")}

    def refs(way: ElementTree.Element) -> list[str]:
        return [nd.get("ref", "") for nd in way.iter("nd")]

    def answer(handler: Handler) -> None:
        query = parse_qs(urlsplit(handler.path).query)["data"][0]
        box = [
            float(one) for one in re.search(r"\((-?[\d.]+(?:,-?[\d.]+){3})\)", query)[1].split(",")
        ]

        def inside(node: ElementTree.Element | None) -> bool:
            return node is not None and (
                box[0] <= float(node.get("lat")) <= box[2]
                and box[1] <= float(node.get("lon")) <= box[3]
            )

        near = [way for way in ways if any(inside(nodes.get(ref)) for ref in refs(way))]
        if "[out:json]" in query:
            patterns = [
                json.loads(f'"{one}"') for one in re.findall(r'~"(\^(?!\()[^"]*)",i', query)
            ]
            sets = [
                {ref for way in near if "highway" in tags(way)
                 and any(re.search(pattern, value, re.IGNORECASE)
                         for key, value in tags(way).items()
                         if re.fullmatch("name|name:en|alt_name|official_name|ref", key))
                 for ref in refs(way)}
                for pattern in patterns
            ]  # fmt: skip
            both = [nodes[ref] for ref in sorted(sets[0] & sets[1]) if ref in nodes]
            elements = [{"type": "node", "id": int(node.get("id")), "lat": float(node.get("lat")),
                         "lon": float(node.get("lon"))} for node in both]  # fmt: skip
            send(handler, json.dumps({"version": 0.6, "elements": elements}).encode())
            return
        wanted = {ref for way in near for ref in refs(way)}
        wanted |= {name for name, node in nodes.items() if inside(node)}
        members = wanted | {way.get("id") for way in near}
        out = ElementTree.Element("osm", version="0.6", generator="Overpass API 0.7.62")
        meta = ElementTree.SubElement(out, "meta")
        meta.set("osm_base", "2026-11-01T00:00:00Z")
        out.extend(nodes[name] for name in sorted(wanted & nodes.keys(), key=int))
        out.extend(near)
        out.extend(
            relation for relation in root.iter("relation")
            if any(one.get("ref") in members for one in relation.iter("member"))
        )  # fmt: skip
        body = b'<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(out) + b"\n"
        send(handler, body, ("Content-Type", "application/osm3s+xml"))

    return answer


def nominatim(places: dict[str, list[dict]]) -> Callable[[Handler], None]:
    """What Nominatim answers (jsonv2): the places whose key is the query, in lower case."""

    def answer(handler: Handler) -> None:
        query = parse_qs(urlsplit(handler.path).query)
        send(handler, json.dumps(places.get(query["q"][0].lower(), [])).encode())

    return answer


def known_place(latitude: float, longitude: float, name: str, half: float = 0.05) -> dict:
    box = [latitude - half, latitude + half, longitude - half, longitude + half]
    return {"lat": f"{latitude}", "lon": f"{longitude}", "display_name": name,
            "boundingbox": [f"{one}" for one in box], "importance": 0.5}  # fmt: skip


def tile_of(latitude: float, longitude: float, zoom: int) -> tuple[int, int]:
    """The tile of the Web Mercator grid (OGC 17-083r2) that holds a place."""
    count = 1 << zoom
    angle = math.asinh(math.tan(math.radians(latitude)))
    return int((longitude + 180) / 360 * count), int((1 - angle / math.pi) / 2 * count)
