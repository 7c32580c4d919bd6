"""Servers that fail, lie or wait: what failed is named, no key is told, and the rest goes on."""

import gzip
import itertools
import json
import struct
import threading
import time
import zlib
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest
from affine import Affine
from rasterio.io import MemoryFile

from urbantwin.acquire.remote_file import BLOCK
from urbantwin.download import Limits
from urbantwin.download import client as client_module
from urbantwin.download import connection as connection_module
from urbantwin.errors import InputError

from . import made_world
from .local_web import send, send_file, serving
from .made_world import EXTRACT, cog, footprint, parquet, row

KEY = "s3cret/key+of mine"
MAP = "/api/interpreter"


def answers(status, *headers, body=b"no"):
    return lambda handler: send(handler, body, *headers, status=status)


def dem(server, path="/dem/N48E009.tif", **more):
    return row(server, "dem", "elevation", "cog", path, crs="EPSG:4326+3855", **more)


def why(got, source="dem"):
    assert got.outcome[source].outcome == "failed"
    assert "\n" not in got.outcome[source].told
    assert any(one.about == source for one in got.found.warnings)
    assert "map" in got.inputs
    assert not [one for one in got.folder.iterdir() if one.name not in ("map.osm",)]
    return got.outcome[source].told


def test_a_server_that_asks_to_wait_is_asked_when_it_said(server, fetch):
    server.faults[MAP] = [answers(429, ("Retry-After", "1"))]
    began = time.monotonic()
    assert "map" in fetch().inputs
    assert time.monotonic() - began >= 1.0
    assert len(server.asked) == 2


def test_a_server_that_asks_to_wait_for_an_hour_is_left_for_its_mirror(server, fetch):
    with serving() as other:
        other.answers["/full"] = answers(429, ("Retry-After", "3600"))
        table = row(server, "osm", "map", "overpass", url=f"{other.url}/full",
                    mirrors=[server.url + MAP])  # fmt: skip
        assert fetch(table).inputs["map"].url == server.url + MAP
        assert len(other.asked) == 1


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (answers(200, body=b"<html><body>Please log in</body></html>"), "not of OpenStreetMap"),
        (answers(200, body=EXTRACT.read_bytes()[:9000]), "the answer ends early"),
        (answers(200, body=b"<osm><remark> runtime error: Query timed out </remark></osm>"),
         "gave up (runtime error: Query timed out)"),
        (answers(504), "the server answers 504"),
        (lambda handler: handler.connection.close(), "cannot be fetched"),
    ],
)  # fmt: skip
def test_a_map_that_is_none_is_refused_and_never_kept(server, fetch, tmp_path, answer, told):
    server.answers[MAP] = answer
    with pytest.raises(InputError) as caught:
        fetch()
    assert told in str(caught.value)
    assert "--offline" in str(caught.value)
    with pytest.raises(InputError, match="is not in the cache"):
        fetch(offline=True)


def test_what_is_cut_is_asked_for_again_and_then_named(server, fetch):
    def half(handler):
        data = server.files["/dem/N48E009.tif"]
        handler.send_response(206)
        handler.send_header("Content-Range", f"bytes 0-{BLOCK - 1}/{len(data)}")
        handler.send_header("Content-Length", str(BLOCK))
        handler.end_headers()
        handler.wfile.write(data[:1000])
        handler.close_connection = True

    server.faults["/dem/N48E009.tif"] = [half, half]
    assert "elevation" in fetch(dem(server)).inputs
    server.answers["/cut.tif"] = half
    assert "ends early" in why(fetch(dem(server, "/cut.tif"), folder="again"))


@pytest.mark.parametrize(
    ("where", "told"),
    [
        ("file:///etc/passwd", "no address of HTTP"),
        ("ftp://127.0.0.1/x", "no address of HTTP"),
        ("http://10.1.2.3/x", "which is not the root's origin"),
        ("http://169.254.169.254/latest/meta-data", "which is not the root's origin"),
        ("/dem/again.tif", "redirected more than"),
    ],
)
def test_a_redirect_elsewhere_is_refused(server, fetch, where, told):
    server.answers["/dem/again.tif"] = answers(302, ("Location", where))
    assert told in why(fetch(dem(server, "/dem/again.tif")))


def test_a_listed_name_that_leads_to_a_private_address_is_refused(server, fetch, monkeypatch):
    """The root is taken for a public one, as it is in the table that comes with the package."""
    public = server.url.rpartition(":")[2]

    def located(host, port):
        numbers = {"inside.example": "10.1.2.3"}.get(host, "127.0.0.1")
        return [(2, (numbers, port))]

    monkeypatch.setattr(client_module, "located", located)
    monkeypatch.setattr(client_module, "is_public", lambda text: text == "127.0.0.1")
    monkeypatch.setattr(client_module, "literal_address", lambda host: None)
    server.answers["/moved.tif"] = answers(302, ("Location", "http://inside.example/x"))
    rows = dem(server, "/moved.tif", origins=["http://inside.example"])
    assert "http://inside.example is a private address" in why(fetch(rows))
    assert public in server.url


def test_a_bomb_of_gzip_is_refused_while_it_is_unpacked(server, fetch):
    packer = zlib.compressobj(9, wbits=31)
    bomb = packer.compress(bytes(40 << 20)) + packer.flush()
    assert len(bomb) < 60_000
    server.answers["/wcs"] = answers(200, ("Content-Encoding", "gzip"), body=bomb)
    table = row(server, "dem", "elevation", "geotiff", "/wcs?{west}")
    got = fetch(table, limits=Limits(8 << 20, 1 << 30, 60.0))
    assert "is larger than 8 MiB" in why(got)


def test_a_bomb_within_a_geotiff_is_refused(server, fetch):
    with MemoryFile() as file:
        with file.open(driver="GTiff", dtype="float32", count=1, width=30_000, height=30_000,
                       crs="EPSG:4326", sparse_ok=True, tiled=True, compress="deflate",
                       transform=Affine(1e-7, 0, 9.1785, 0, -1e-7, 48.7015),
                       ) as out:  # fmt: skip
            out.write(np.zeros((1, 256, 256), np.float32), window=((0, 256), (0, 256)))
        server.files["/wide.tif"] = file.read()
    assert "more than a site needs" in why(fetch(dem(server, "/wide.tif")))


def test_a_server_that_stalls_is_given_up(server, fetch, monkeypatch):
    monkeypatch.setattr(connection_module, "QUIET_S", 0.2)
    over = threading.Event()
    server.answers["/slow.tif"] = lambda _: over.wait(20)
    began = time.monotonic()
    got = fetch(dem(server, "/slow.tif"))
    over.set()
    assert "cannot be fetched (no answer in time)" in why(got)
    assert time.monotonic() - began < 10


def test_a_server_may_think_as_long_as_its_row_says(server, fetch, monkeypatch, tmp_path):
    monkeypatch.setattr(connection_module, "QUIET_S", 0.2)
    monkeypatch.setattr(connection_module, "GRACE_S", 0.3)
    at_once = server.answers[MAP]

    def thinking(handler):
        time.sleep(0.6)
        at_once(handler)

    server.answers[MAP] = thinking
    table = row(server, "osm", "map", "overpass", MAP)
    assert "map" in fetch({**table, "think_s": 20.0}).inputs
    with pytest.raises(InputError, match="no answer in time"):
        fetch(table, cache=tmp_path / "another", folder="again")


def test_a_server_without_ranges_sends_the_whole_file(server, fetch):
    data = cog(9.1, 48.6, 0.2, 340)
    assert len(data) > 2 * BLOCK
    server.answers["/plain.tif"] = lambda handler: send(handler, data)
    assert "elevation" in fetch(dem(server, "/plain.tif")).inputs
    assert sum("plain" in path for path in server.paths()) == 1


def test_a_file_that_is_replaced_while_it_is_read_is_not_half_and_half(server, fetch):
    numbers = itertools.count()
    data = [cog(9.0, 48.0, 1.0, 700, fine=float(k)) for k in range(2)]
    server.answers["/new.tif"] = lambda handler: send_file(handler, data[min(next(numbers), 1)])
    assert "has changed while it was read" in why(fetch(dem(server, "/new.tif")))
    assert "elevation" in fetch(dem(server, "/new.tif"), folder="again").inputs


@pytest.mark.parametrize("cut", ["footer", "middle", "not one"])
def test_a_parquet_file_that_is_damaged_is_named(server, fetch, cut):
    data = parquet([footprint(0, 10.0 * k) for k in range(9)], [3.0] * 9)
    server.files["/b.parquet"] = {
        "footer": data[: len(data) - 300],
        "middle": data[:200] + bytes(len(data) - 1400) + data[-1200:],
        "not one": b"PAR1 but nothing else",
    }[cut]
    told = why(fetch(row(server, "dem", "buildings", "geoparquet", "/b.parquet")))
    assert told == "cannot be read as GeoParquet"


def rescaled(survey):
    """The same points with heights of thousands of kilometres: a step of z (LAS 1.4, 2.4)."""
    return survey[:147] + struct.pack("<d", 1e6) + survey[155:]


@pytest.mark.parametrize(
    ("access", "files"),
    [
        ("copc", {"/s": lambda data: data["/survey.copc.laz"][:5000]}),
        ("copc", {"/s": lambda data: b"LASF" + bytes(5000)}),
        ("copc", {"/s": lambda data: data["/dem/N48E009.tif"]}),
        ("copc", {"/s": lambda data: rescaled(data["/survey.copc.laz"])}),
        ("ept", {"/s": lambda data: b"[1, 2"}),
        ("ept", {"/s": lambda data: data["/ept/ept.json"].replace(b"laszip", b"binary")}),
        ("ept", {"/s": lambda data: data["/ept/ept.json"].replace(b'"bounds"', b'"bonds"')}),
        ("ept", {"/s": lambda data: data["/ept/ept.json"]
                                 .replace(b'"bounds"', b'"bounds":[0],"b"')}),
        ("ept", {"/s": lambda data: data["/ept/ept.json"],
                 "/ept-hierarchy/0-0-0-0.json": lambda data: b'{"0-0-0-0": -1}'}),
        ("ept", {"/s": lambda data: data["/ept/ept.json"],
                 "/ept-hierarchy/0-0-0-0.json": lambda data: b'{"0-0-0-0": 99}',
                 "/ept-data/0-0-0-0.laz": lambda data: b"LASF no more"}),
    ],
)  # fmt: skip
def test_points_of_a_wrong_type_are_named(server, fetch, access, files):
    server.files |= {path: make(server.files) for path, make in files.items()}
    assert why(fetch(row(server, "dem", "airborne", access, "/s")))


def test_tiles_that_are_no_pictures_are_named(server, fetch):
    server.answers |= {
        f"/t/12/{x}/{y}.png": answers(200, body=b"<html>") for x in range(2000, 2300)
        for y in range(1300, 1500)
    }  # fmt: skip
    table = row(server, "dem", "imagery", "xyz", "/t/{z}/{x}/{y}.png", zoom=12)
    assert "not an image" in why(fetch(table))


def test_a_picture_of_one_colour_is_none(server, fetch):
    blank = made_world.picture(7, 7)
    server.answers |= {
        f"/t/17/{x}/{y}.png": answers(200, body=blank) for x in range(68870, 68885)
        for y in range(45170, 45190)
    }  # fmt: skip
    table = row(server, "dem", "imagery", "xyz", "/t/{z}/{x}/{y}.png", zoom=17)
    assert "shows one colour" in why(fetch(table))


def test_a_key_is_told_to_its_server_and_to_nobody_else(server, fetch, tmp_path):
    """It stands in the address, and the server writes it into whatever it answers."""
    heights = cog(9.1, 48.6, 0.2, 64)
    told = []

    def cut_out(handler):
        told.append(parse_qs(urlsplit(handler.path).query)["key"][0])
        send(handler, heights, ("X-Key", KEY))

    sorry = f"<osm><remark>runtime error: bad key {KEY}</remark></osm>".encode()
    echo = EXTRACT.read_bytes().replace(b"make_inputs.py", KEY.encode())
    server.answers |= {
        "/wcs": cut_out,
        "/sorry": answers(200, body=sorry),
        "/echo": answers(200, body=echo),
    }
    with_key = {"key_env": "MY_KEY"}
    got = fetch(
        row(server, "sorry", "map", "overpass", "/sorry?key={key}", **with_key),
        row(server, "echo", "map", "overpass", "/echo?key={key}", **with_key),
        row(server, "osm", "map", "overpass", MAP),
        row(server, "dem", "elevation", "geotiff", "/wcs?w={west}&key={key}", **with_key),
        row(server, "none", "airborne", "copc", "/s.laz?key={key}", key_env="NO_KEY"),
        environment={"MY_KEY": KEY},
    )
    assert set(told) == {KEY}
    assert "elevation" in got.inputs
    assert "bad key ***" in got.outcome["sorry"].told
    assert got.outcome["echo"].told == "is refused: the answer contains the key"
    assert got.outcome["none"].told == "needs a key in the environment variable NO_KEY"
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert len(files) > 4
    held = b"".join(path.read_bytes() + str(path).encode() for path in files)
    for form in (KEY, "s3cret", "s3cret%2Fkey"):
        assert form not in repr(got.found)
        assert form.encode() not in held
        if "s3cret" in form:
            assert form not in json.dumps([one.row() for one in got.found.attempts])


def test_a_key_without_a_value_stops_no_other_source(server, fetch):
    table = row(
        server, "dem", "elevation", "cog", "/dem/N48E009.tif", key_env="K", resolution_m=1.0
    )
    got = fetch(table, row(server, "free", "elevation", "cog", "/dem/N48E009.tif"))
    assert got.outcome["dem"].outcome == "no key"
    assert got.inputs["elevation"].source.name == "free"


def test_gzip_of_an_answer_is_unpacked(server, fetch):
    plain = server.answers[MAP]

    class Packed:
        def __init__(self, handler):
            self.path, self.handler = handler.path, handler
            self.wfile = self

        def __getattr__(self, name):
            return lambda *_: None

        def write(self, body):
            send(self.handler, gzip.compress(body), ("Content-Encoding", "gzip"))

    server.answers[MAP] = lambda handler: plain(Packed(handler))
    assert "map" in fetch().inputs
