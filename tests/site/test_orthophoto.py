"""Pictures of the ground: where a line lands, and what is wrong with files and tiles."""

import contextlib
import http.server
import io
import socket
import struct
import threading
from types import SimpleNamespace
from zlib import compress, crc32

import numpy as np
import pytest
import rasterio
import shapely
from PIL import Image
from pydantic import ValidationError
from pyproj import Transformer
from rasterio.transform import Affine

from urbantwin.download import Limits, keys_allowed
from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.site import Orthophoto, map_tiles, read_orthophoto
from urbantwin.site.imagery import ImagerySource, ImagerySpec
from urbantwin.site.yaml_document import Document

AREA = shapely.box(-30.0, -25.0, 30.0, 25.0)
#: A white line on dark ground: where ``x cos + y sin`` is this, metres.
TURN, OFFSET, WIDE = np.radians(25.0), 3.7, 0.6
PLACES = {
    "EPSG:28992": (52.0116, 4.3571),
    "EPSG:25832": (48.137, 11.575),
    "EPSG:32617": (40.4627, -79.951),
    "EPSG:3857": (52.4, 13.4),
    "EPSG:4326": (-37.8, 144.96),
    "EPSG:2193": (-41.29, 174.78),
}


def across(x, y):
    return x * np.cos(TURN) + y * np.sin(TURN) - OFFSET


def colours(xy, shape):
    """Red: the line, blurred a little by hand; green: the north half; blue: always 40."""
    d = np.abs(across(*xy.T)).reshape(shape)
    red = 40 + 200 * np.clip((WIDE / 2 - d) / 0.1 + 0.5, 0, 1)
    green = np.where(xy[:, 1].reshape(shape) > 0, 200, 40)
    return np.stack([red, green, np.full(shape, 40)]).astype(np.uint8)


def source(folder, **spec):
    document = Document(folder / "site.yaml", {})
    return ImagerySource(ImagerySpec.model_validate(spec), document, 0)


def write_picture(path, crs, frame, pixel_m, *, half=45.0, alpha=None, **more):
    """Colour every pixel by where PROJ says that it lies: no resampling of ours."""
    to_crs = Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    ring = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    corners = np.column_stack(to_crs.transform(*frame.lonlat_from_site(ring).T))
    low, high = corners.min(axis=0), corners.max(axis=0)
    count = int(2 * half / pixel_m)
    step = (high - low) / count
    transform = Affine(step[0], 0, low[0], 0, -step[1], high[1])
    column, row = np.meshgrid(np.arange(count) + 0.5, np.arange(count) + 0.5)
    x, y = transform.c + transform.a * column.ravel(), transform.f + transform.e * row.ravel()
    lonlat = np.column_stack(to_crs.transform(x, y, direction="INVERSE"))
    bands = colours(frame.site_from_lonlat(lonlat), (count, count))
    if alpha is not None:
        bands = np.concatenate([bands, alpha(count)[None]])
    profile = {
        "driver": "GTiff", "width": count, "height": count, "count": len(bands),
        "dtype": bands.dtype, "crs": crs, "transform": transform, **more,
    }  # fmt: skip
    with rasterio.open(path, "w", **profile) as out:
        out.write(bands)
        if alpha is not None:
            out.colorinterp = [*out.colorinterp[:3], rasterio.enums.ColorInterp.alpha]


def middle_of_line(photo: Orthophoto):
    """How far the line's middle is from where it should be, metres (N,), by its brightness."""
    ny, nx = photo.known.shape
    x = photo.x0 + (np.arange(nx) + 0.5) * photo.cell_m
    y = photo.y0 + (np.arange(ny) + 0.5) * photo.cell_m
    off = across(*np.meshgrid(x, y))
    light = np.where(np.abs(off) < 1.5, photo.rgb[..., 0].astype(float) - 40, 0)
    whole = (np.abs(off) < 1.5) & photo.known
    rows = whole[:, [0, -1]].sum(axis=1) == 0
    rows &= light.sum(axis=1) > 0
    return (light * off).sum(axis=1)[rows] / light.sum(axis=1)[rows]


@pytest.mark.parametrize(
    ("crs", "pixel_m"), [*((crs, 0.25) for crs in sorted(PLACES)), ("EPSG:28992", 0.1)]
)
def test_a_line_lands_within_half_a_pixel(tmp_path, crs, pixel_m):
    frame = SiteFrame(*PLACES[crs])
    write_picture(tmp_path / "o.tif", crs, frame, pixel_m)
    photo = read_orthophoto([source(tmp_path, file="o.tif")], frame, AREA)
    assert photo.cell_m == pytest.approx(pixel_m, rel=0.7)
    assert photo.known.all()
    off = middle_of_line(photo)
    assert len(off) > 80
    assert np.abs(off).max() < pixel_m / 2
    assert np.abs(off.mean()) < pixel_m / 8
    # North is north: the upper half is green.
    half = len(photo.rgb) // 2
    assert (photo.rgb[half + 3 :, :, 1] > 150).all()
    assert (photo.rgb[: half - 3, :, 1] < 90).all()


def test_transparent_and_missing_parts_are_not_known(tmp_path):
    frame = SiteFrame(*PLACES["EPSG:25832"])

    def hole(count):
        alpha = np.full((count, count), 255, np.uint8)
        alpha[: count // 2] = 0  # the north
        return alpha

    write_picture(tmp_path / "o.tif", "EPSG:25832", frame, 0.25, alpha=hole)
    photo = read_orthophoto([source(tmp_path, file="o.tif")], frame, AREA)
    half = len(photo.known) // 2
    # Grid north of UTM leans by two degrees there.
    assert not photo.known[half + 8 :].any()
    assert photo.known[: half - 8].all()
    write_picture(tmp_path / "small.tif", "EPSG:25832", frame, 0.25, half=10.0)
    small = read_orthophoto([source(tmp_path, file="small.tif")], frame, AREA)
    assert small.notes[0]["covers"] == pytest.approx(400 / 3000, rel=0.1)
    both = [source(tmp_path, file="small.tif"), source(tmp_path, file="o.tif")]
    joined = read_orthophoto(both, frame, AREA)
    np.testing.assert_array_equal(joined.known, small.known | photo.known)


def tile_png(frame, zoom, x, y, side=256):
    """A tile by the grid's definition: longitudes by thirds of a turn, latitudes by the sinh."""
    u, v = np.meshgrid(x + (np.arange(side) + 0.5) / side, y + (np.arange(side) + 0.5) / side)
    longitude = u / 2**zoom * 360 - 180
    latitude = np.degrees(np.arctan(np.sinh(np.pi * (1 - 2 * v / 2**zoom))))
    xy = frame.site_from_lonlat(np.column_stack([longitude.ravel(), latitude.ravel()]))
    out = io.BytesIO()
    picture = np.moveaxis(colours(xy, (side, side)), 0, 2)
    Image.fromarray(picture).save(out, "PNG")
    return out.getvalue()


def tiles_of(frame, zoom, area=AREA):
    corners = frame.lonlat_from_site(np.array(area.exterior.coords))
    x = (corners[:, 0] + 180) / 360 * 2**zoom
    y = (1 - np.arcsinh(np.tan(np.radians(corners[:, 1]))) / np.pi) / 2 * 2**zoom
    return [
        (i, j)
        for i in range(int(x.min()), int(x.max()) + 1)
        for j in range(int(y.min()), int(y.max()) + 1)
    ]


def answering(tiles, asked):
    """A server on this machine; ``tiles`` maps paths to bytes, or text to redirect to."""

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append(self.path)
            data = tiles.get(self.path.split("?")[0])
            if isinstance(data, str):
                self.send_response(302)
                self.send_header("Location", data)
                self.end_headers()
                return
            self.send_response(200 if data else 404)
            self.end_headers()
            self.wfile.write(data or b"")

        def log_message(self, *_):
            pass

    return http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)


@contextlib.contextmanager
def serving():
    state = SimpleNamespace(tiles={}, asked=[])
    running = answering(state.tiles, state.asked)
    thread = threading.Thread(target=running.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    state.address = f"http://127.0.0.1:{running.server_port}"
    try:
        yield state
    finally:
        running.shutdown()
        running.server_close()
        thread.join()


@pytest.fixture
def server():
    with serving() as state:
        yield state


@pytest.fixture
def other():
    """A server of another port: another origin."""
    with serving() as state:
        yield state


@pytest.fixture(autouse=True)
def short_pauses(monkeypatch):
    monkeypatch.setattr("urbantwin.download.client.PAUSE_S", 0.001)


def allowed(server):
    return keys_allowed(None, [f"MAP_KEY={server.address}"])


def test_tiles_of_an_address_make_one_picture(tmp_path, server):
    frame = SiteFrame(52.4, 13.4)
    for x, y in tiles_of(frame, 19):
        server.tiles[f"/t/19/{x}/{y}.png"] = tile_png(frame, 19, x, y)
    spec = {"xyz": server.address + "/t/{z}/{x}/{y}.png?style=a", "key_env": "MAP_KEY"}
    with allowed(server):
        photo = read_orthophoto([source(tmp_path, **spec)], frame, AREA, {"MAP_KEY": "se&cret"})
    pixel_m = 2 * np.pi * 6378137 / 2**19 / 256 * np.cos(np.radians(52.4))
    assert photo.known.all()
    assert np.abs(middle_of_line(photo)).max() < pixel_m / 2
    assert all("?style=a&key=se%26cret" in path for path in server.asked)
    assert "secret" not in str(photo.notes)
    assert "cret" not in str(photo.notes)


def test_a_bad_tile_is_reported_and_the_rest_is_used(tmp_path, server):
    frame = SiteFrame(52.4, 13.4)
    places = tiles_of(frame, 20)
    for x, y in places:
        server.tiles[f"/20/{x}/{y}"] = tile_png(frame, 20, x, y)
    gone, cut, page, odd = places[1], places[3], places[5], places[7]
    del server.tiles["/20/{}/{}".format(*gone)]
    name = "/20/{}/{}".format(*cut)
    server.tiles[name] = server.tiles[name][: len(server.tiles[name]) // 2]
    server.tiles["/20/{}/{}".format(*page)] = b"<html>quota exceeded</html>"
    out = io.BytesIO()
    Image.new("RGB", (5000, 3)).save(out, "PNG")
    server.tiles["/20/{}/{}".format(*odd)] = out.getvalue()
    spec = {"xyz": server.address + "/{z}/{x}/{y}", "zoom": 20}
    photo = read_orthophoto([source(tmp_path, **spec)], frame, AREA, {})
    problems = sorted(photo.notes[0]["problems"])
    assert problems == sorted(
        [
            "tile 20/{}/{}: not there (status 404)".format(*gone),
            "tile 20/{}/{}: not an image".format(*cut),
            "tile 20/{}/{}: not an image".format(*page),
            "tile 20/{}/{}: 5000 x 3 pixels".format(*odd),
        ]
    )
    assert 0.4 < photo.known.mean() < 1.0
    assert np.abs(middle_of_line(photo)).max() < 0.1


def test_tiles_of_local_files_and_rows_counted_from_the_south(tmp_path):
    frame = SiteFrame(-37.8, 144.96)
    for x, y in tiles_of(frame, 19):
        path = tmp_path / "tiles" / "19" / str(x) / f"{2**19 - 1 - y}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(tile_png(frame, 19, x, y, side=512))
    one = source(tmp_path, xyz="tiles/{z}/{x}/{-y}.png")
    photo = read_orthophoto([one], frame, AREA)
    assert photo.known.all()
    assert np.abs(middle_of_line(photo)).max() < 0.12
    assert source(tmp_path, xyz="/home/me/tiles/{z}/{x}/{y}.png").name == "tiles/{z}/{x}/{y}.png"


def bad_file(tmp_path, kind):
    frame = SiteFrame(*PLACES["EPSG:25832"])
    path = tmp_path / "o.tif"
    write_picture(path, "EPSG:25832", frame, 0.25)
    if kind in ("bands", "deep", "grey", "no crs"):
        with rasterio.open(path) as raster:
            data, profile = raster.read(), raster.profile
        if kind == "bands":
            data = np.concatenate([data, data])
        if kind == "grey":
            data = data[:1]
        if kind == "deep":
            data = data.astype(np.uint16)
        if kind == "no crs":
            profile["crs"] = None
        profile.update(count=len(data), dtype=data.dtype)
        with rasterio.open(path, "w", **profile) as out:
            out.write(data)
    if kind == "cut":
        whole = path.read_bytes()
        path.write_bytes(whole[: len(whole) // 3])
    if kind == "elsewhere":
        write_picture(path, "EPSG:25832", SiteFrame(48.5, 11.6), 0.25)
    if kind == "another continent":
        write_picture(path, "EPSG:2193", SiteFrame(*PLACES["EPSG:2193"]), 0.25)
    if kind == "text":
        path.write_text("not a picture")
    return frame


@pytest.mark.parametrize(
    ("kind", "problem"),
    [
        ("bands", "holds 6 bands"),
        ("grey", "holds 1 band"),
        ("deep", "holds uint16"),
        ("no crs", "has no CRS"),
        ("cut", "cannot be read as a GeoTIFF"),
        ("text", "cannot be read as a GeoTIFF"),
        ("elsewhere", "covers nothing of the region"),
        ("another continent", "covers nothing of the region"),
    ],
)
def test_what_is_wrong_with_a_file_is_said_in_one_line(tmp_path, kind, problem):
    frame = bad_file(tmp_path, kind)
    with pytest.raises(InputError, match=problem) as caught:
        read_orthophoto([source(tmp_path, file="o.tif")], frame, AREA)
    assert "\n" not in str(caught.value)
    assert "o.tif" in str(caught.value)


def test_a_person_may_say_the_crs_that_a_file_lacks(tmp_path):
    frame = bad_file(tmp_path, "no crs")
    photo = read_orthophoto([source(tmp_path, file="o.tif", crs="EPSG:25832")], frame, AREA)
    assert np.abs(middle_of_line(photo)).max() < 0.125
    with pytest.raises(InputError, match="is 'EPSG:1', which is not known"):
        read_orthophoto([source(tmp_path, file="o.tif", crs="EPSG:1")], frame, AREA)


def test_tiles_that_cannot_be_had_are_said_in_one_line(tmp_path, server):
    frame = SiteFrame(52.4, 13.4)
    address = server.address + "/{z}/{x}/{y}.png"
    with pytest.raises(InputError, match=r"no tile of http.* can be read \(tile 19/.*404"):
        read_orthophoto([source(tmp_path, xyz=address)], frame, AREA, {})
    with allowed(server), pytest.raises(InputError, match="variable MAP_KEY is not set"):
        read_orthophoto([source(tmp_path, xyz=address, key_env="MAP_KEY")], frame, AREA, {})
    with pytest.raises(InputError, match=r"is 24: the region is \d+ tiles"):
        wide = shapely.box(-900, -900, 900, 900)
        read_orthophoto([source(tmp_path, xyz=address, zoom=24)], frame, wide, {})
    with pytest.raises(InputError, match="not found"):
        read_orthophoto([source(tmp_path, xyz="tiles/{z}/{x}/{y}.png")], frame, AREA, {})
    nobody = "http://127.0.0.1:9/{z}/{x}/{y}.png"
    with pytest.raises(InputError, match="cannot be fetched"):
        read_orthophoto([source(tmp_path, xyz=nobody)], frame, AREA, {})


@pytest.mark.parametrize("where", ["in the path", "as a parameter"])
def test_the_key_of_tiles_goes_to_their_origin_only(tmp_path, server, other, where):
    frame = SiteFrame(52.4, 13.4)
    folder = "/t/se%26cret" if where == "in the path" else "/t"
    for x, y in tiles_of(frame, 19):
        server.tiles[f"{folder}/19/{x}/{y}.png"] = f"{other.address}/{x}/{y}?v=1&key=se%26cret"
        other.tiles[f"/{x}/{y}"] = tile_png(frame, 19, x, y)
    address = (
        f"{server.address}/t{'/{key}' if where == 'in the path' else ''}/{{z}}/{{x}}/{{y}}.png"
    )
    spec = {"xyz": address, "key_env": "MAP_KEY"}
    wrong = f"it redirects to {other.address}, which"
    with allowed(server), pytest.raises(InputError, match=wrong) as caught:
        read_orthophoto([source(tmp_path, **spec)], frame, AREA, {"MAP_KEY": "se&cret"})
    assert "cret" not in str(caught.value)
    assert not other.asked
    one = source(tmp_path, **spec, origins=[other.address])
    with allowed(server):
        photo = read_orthophoto([one], frame, AREA, {"MAP_KEY": "se&cret"})
    assert photo.known.all()
    assert other.asked
    assert all(path.endswith("?v=1") for path in other.asked)
    assert all("cret" in path for path in server.asked)


def test_tiles_have_limits_of_size_and_time(tmp_path, server, monkeypatch):
    frame = SiteFrame(52.4, 13.4)
    for x, y in tiles_of(frame, 19):
        server.tiles[f"/19/{x}/{y}"] = tile_png(frame, 19, x, y)
    spec = {"xyz": server.address + "/{z}/{x}/{y}"}
    big = next(iter(server.tiles))
    server.tiles[big] += bytes(map_tiles.MOST_BYTES)
    photo = read_orthophoto([source(tmp_path, **spec)], frame, AREA, {})
    assert [one.split(": ")[1] for one in photo.notes[0]["problems"]] == ["is larger than 5 MB"]
    monkeypatch.setattr(map_tiles, "LIMITS", Limits(map_tiles.MOST_BYTES, 5000, 60.0))
    with pytest.raises(InputError, match=r"imagery\[0\].xyz: needs more than .* altogether"):
        read_orthophoto([source(tmp_path, **spec)], frame, AREA, {})
    monkeypatch.setattr(map_tiles, "LIMITS", Limits(map_tiles.MOST_BYTES, 1 << 30, -1.0))
    with pytest.raises(InputError, match=r"imagery\[0\].xyz: takes longer than .* a lower zoom"):
        read_orthophoto([source(tmp_path, **spec)], frame, AREA, {})


def png(width, height, *chunks):
    """A PNG whose header claims a size, with further chunks."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    body = b"".join(chunk(kind, data) for kind, data in chunks)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + body + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    "data",
    [
        png(12_000, 9_000),
        png(60_000, 60_000),
        png(2**31 - 1, 2**31 - 1),
        png(256, 256),
        png(256, 256, (b"IDAT", b"no zlib")),
        png(256, 256, (b"zTXt", b"a\0\0" + compress(bytes(50_000_000), 1))),
        png(256, 256, (b"iCCP", b"a\0\0" + compress(bytes(50_000_000), 1))),
        b"GIF89a" + bytes(50),
        b"RIFF\x10\0\0\0WEBPVP8X" + bytes(20),
        b"\xff\xd8\xff\xe0" + bytes(40),
    ],
)
def test_what_pretends_to_be_a_tile_is_one_line(tmp_path, server, data):
    frame = SiteFrame(52.4, 13.4)
    places = tiles_of(frame, 19)
    for x, y in places:
        server.tiles[f"/19/{x}/{y}"] = tile_png(frame, 19, x, y)
    server.tiles["/19/{}/{}".format(*places[0])] = data
    one = source(tmp_path, xyz=server.address + "/{z}/{x}/{y}")
    photo = read_orthophoto([one], frame, AREA, {})
    (problem,) = photo.notes[0]["problems"]
    assert problem.startswith("tile 19/")
    assert "not an image" in problem or "pixels" in problem


@pytest.mark.parametrize(
    ("address", "problem"),
    [
        ("file:///etc/{z}/{x}/{y}", "is not an address of HTTP"),
        ("ftp://host/{z}/{x}/{y}", "is not an address of HTTP"),
        ("https://{key}.host/{z}/{x}/{y}", "is not an address of HTTP"),
        ("https://host{x}/{z}/{x}/{y}", "is not an address of HTTP"),
        ("https://me:pass@host/{z}/{x}/{y}", "a name or a password"),
    ],
)
def test_addresses_of_tiles_that_are_none(address, problem):
    with pytest.raises(ValidationError, match=problem) as caught:
        ImagerySpec(xyz=address, key_env="MAP_KEY")
    assert "pass@" not in str(caught.value.errors(include_input=False))


def test_a_crs_is_no_address(tmp_path):
    frame = bad_file(tmp_path, "no crs")
    with socket.create_server(("127.0.0.1", 0)) as listening:
        listening.settimeout(0.05)
        address = f"http://127.0.0.1:{listening.getsockname()[1]}/crs"
        for crs in (address, f"/vsicurl/{address}"):
            with pytest.raises(InputError, match="which is not known"):
                read_orthophoto([source(tmp_path, file="o.tif", crs=crs)], frame, AREA)
        with pytest.raises(TimeoutError):
            listening.accept()
    photo = read_orthophoto(
        [source(tmp_path, file="o.tif", crs="ETRS89 / UTM zone 32N")], frame, AREA
    )
    assert np.abs(middle_of_line(photo)).max() < 0.125
