"""Tiles over HTTP: a server of the standard library that keeps a log of what it is asked."""

import contextlib
import gzip
import json
import os
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest
from pydantic import ValidationError

from urbantwin.download import Limits
from urbantwin.errors import InputError
from urbantwin.site.geometry import GeometrySpec

from .tile_bytes import Gltf
from .tileset_site import names, read, tile, write

KEY = "s3cret-key"


@pytest.fixture(autouse=True)
def short_pauses(monkeypatch):
    monkeypatch.setattr("urbantwin.download.client.PAUSE_S", 0.005)
    monkeypatch.delenv("URBANTWIN_TILE_CACHE", raising=False)


def square() -> bytes:
    gltf = Gltf()
    return gltf.scene({"mesh": gltf.mesh(np.eye(3))}).glb()


class Server:
    """Serves ``pages``; an entry may be bytes, a status, or a list of answers one after another."""

    def __init__(self, pages: dict, allowed) -> None:
        self.pages, self.allowed = pages, allowed
        self.log: list[tuple[str, dict, str | None]] = []
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self):
                parts = urlsplit(self.path)
                query = {key: value[0] for key, value in parse_qs(parts.query).items()}
                token = self.headers.get("Authorization")
                outer.log.append((parts.path, query, token))
                answer = outer.pages.get(parts.path, 404)
                if isinstance(answer, list):
                    answer = answer.pop(0) if len(answer) > 1 else answer[0]
                if not outer.allowed(query, token):
                    answer = 403
                if isinstance(answer, str):
                    self.send_response(302)
                    self.send_header("Location", answer)
                    self.end_headers()
                    return
                if isinstance(answer, int):
                    self.send_error(answer)
                    return
                self.send_response(200)
                self.send_header("Content-Length", str(len(answer)))
                self.end_headers()
                self.wfile.write(answer)

            def log_message(self, *args):
                pass

        self.http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.http.server_port}"


@contextlib.contextmanager
def serving(pages: dict, allowed=lambda query, token: True) -> Iterator[Server]:
    server = Server(pages, allowed)
    thread = threading.Thread(target=server.http.serve_forever, args=(0.01,), daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.http.shutdown()
        server.http.server_close()
        thread.join(5)


def tileset(folder, root: dict) -> bytes:
    return write(folder, root, {}).read_bytes()


def children(*uris: str) -> dict:
    tiles = [tile(0, -9, -9, 9, 9, content={"uri": uri}) for uri in uris]
    return tile(9, -9, -9, 9, 9, refine="ADD", children=tiles)


def everything(model) -> str:
    """All that a model says, as it would be written."""
    return json.dumps([model.problems, model.notes, model.files, model.mesh.names])


def test_key_and_session_reach_every_tile_and_no_report(tmp_path, monkeypatch):
    """As Google's tiles want it: the session of the first answer in every further address."""
    monkeypatch.setenv("TILES_KEY", KEY)
    external = {"root": children("/v1/deep/a.glb?session=overridden", "b.glb", "gone.glb")}
    pages = {
        "/v1/root.json": tileset(tmp_path, children("/v1/sub/inner.json?session=abc")),
        "/v1/sub/inner.json": gzip.compress(json.dumps(external).encode()),
        "/v1/deep/a.glb": square(),
        "/v1/sub/b.glb": square(),
    }
    with serving(pages, lambda query, token: query.get("key") == KEY) as server:
        model = read(f"{server.url}/v1/root.json", key_env="TILES_KEY")
    assert names(model) == {"deep/a.glb", "sub/b.glb"}
    asked = {path: query for path, query, _ in server.log}
    assert asked["/v1/root.json"] == {"key": KEY}
    assert asked["/v1/sub/inner.json"] == {"key": KEY, "session": "abc"}
    assert asked["/v1/sub/b.glb"] == {"key": KEY, "session": "abc"}
    assert asked["/v1/deep/a.glb"] == {"key": KEY, "session": "overridden"}
    assert model.problems == ("sub/gone.glb: not found (404)",)
    assert KEY not in everything(model)
    assert "session" not in everything(model)
    assert set(model.files) == {"root.json", "sub/inner.json", "deep/a.glb", "sub/b.glb"}


def test_a_token_is_a_header_and_goes_to_its_own_origin_only(tmp_path, monkeypatch):
    monkeypatch.setenv("ION_TOKEN", KEY)
    with serving({"/far.glb": square(), "/moved.glb": square()}) as other:
        elsewhere = other.url.replace("127.0.0.1", "localhost")
        pages = {
            "/t.json": tileset(tmp_path, children("near.glb", f"{elsewhere}/far.glb", "go.glb")),
            "/near.glb": square(),
            "/go.glb": f"{elsewhere}/moved.glb",
        }
        with serving(pages, lambda query, token: token == f"Bearer {KEY}") as server:
            url = f"{server.url}/t.json"
            model = read(url, key_env="ION_TOKEN", origins=[elsewhere])
    assert len(model.mesh.faces) == 3
    assert not model.problems
    assert len(other.log) == 2
    assert all(token is None and not query for _, query, token in other.log)


def test_a_server_that_stumbles_is_asked_again(tmp_path):
    pages = {
        "/t.json": [503, tileset(tmp_path, children("a.glb", "never.glb", "forbidden.glb"))],
        "/a.glb": [500, 429, square()],
        "/never.glb": 500,
        "/forbidden.glb": 403,
    }
    with serving(pages) as server:
        model = read(f"{server.url}/t.json")
    assert names(model) == {"a.glb"}
    asked = [path for path, _, _ in server.log]
    assert asked.count("/a.glb") == 3
    assert asked.count("/never.glb") == 4
    assert asked.count("/forbidden.glb") == 1
    assert model.problems == (
        "never.glb: cannot be fetched (the server answers 500)",
        "forbidden.glb: is refused by the server (403): is the key right?",
    )


def test_what_was_fetched_is_kept_where_a_folder_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv("URBANTWIN_TILE_CACHE", str(tmp_path / "kept"))
    monkeypatch.setenv("TILES_KEY", KEY)
    pages = {"/t.json": tileset(tmp_path, children("a.glb")), "/a.glb": square()}
    with serving(pages) as server:
        first = read(f"{server.url}/t.json", key_env="TILES_KEY")
        asked = len(server.log)
        monkeypatch.setenv("TILES_KEY", "another")
        second = read(f"{server.url}/t.json", key_env="TILES_KEY")
        assert len(server.log) == asked == 2
    assert first.files == second.files
    np.testing.assert_array_equal(first.mesh.vertices, second.mesh.vertices)
    kept = [path for path in (tmp_path / "kept").rglob("*") if path.is_file()]
    assert len(kept) == 2
    assert not any(KEY in str(path) or KEY.encode() in path.read_bytes() for path in kept)


@pytest.mark.parametrize(
    ("url", "spec", "words"),
    [
        ("/t.json", {"key_env": "NOT_SET_ANYWHERE"}, "NOT_SET_ANYWHERE is not set"),
        ("/gone.json", {}, "not found (404)"),
        ("/locked.json", {"key_env": "TILES_KEY"}, "is the key right?"),
    ],
)
def test_what_is_wrong_is_one_line_without_the_key(monkeypatch, url, spec, words):
    monkeypatch.setenv("TILES_KEY", KEY)
    with serving({"/locked.json": 403}) as server, pytest.raises(InputError) as caught:
        read(server.url + url, **spec)
    assert words in str(caught.value)
    assert KEY not in str(caught.value)
    assert "\n" not in str(caught.value)


def test_addresses_of_other_kinds_are_refused(tmp_path):
    secret = tmp_path / "secret.glb"
    secret.write_bytes(square())
    pages = {
        "/t.json": tileset(
            tmp_path, children(f"file://{secret}", "ftp://127.0.0.1/a", "a.glb", "go")
        ),
        "/a.glb": square(),
        "/go": f"file://{secret}",
    }
    with serving(pages) as server:
        model = read(f"{server.url}/t.json")
    assert names(model) == {"a.glb"}
    assert len(model.problems) == 3
    with pytest.raises(InputError, match="not an address of HTTP"):
        read("ftp://127.0.0.1/t.json")


def test_nobody_answers():
    with serving({}) as server:
        url = server.url
    with pytest.raises(InputError, match="cannot be fetched"):
        read(f"{url}/t.json")


def test_another_port_is_asked_only_if_it_is_listed(tmp_path, monkeypatch):
    monkeypatch.setenv("TILES_KEY", KEY)
    with serving({"/far.glb": square(), "/moved.glb": square()}) as other:
        pages = {
            "/t.json": tileset(tmp_path, children("a.glb", f"{other.url}/far.glb", "go.glb")),
            "/a.glb": square(),
            "/go.glb": f"{other.url}/moved.glb?key={KEY}",
        }
        with serving(pages) as server:
            model = read(f"{server.url}/t.json", key_env="TILES_KEY")
            assert not other.log
            assert names(model) == {"a.glb"}
            assert len(model.problems) == 2
            assert all(f"{other.url}, which is not the root's" in line for line in model.problems)
            model = read(f"{server.url}/t.json", key_env="TILES_KEY", origins=[other.url])
    assert len(model.mesh.faces) == 3
    assert not model.problems
    assert sorted(other.log) == [("/far.glb", {}, None), ("/moved.glb", {}, None)]
    assert KEY not in everything(model)
    assert f"{other.url}/far.glb" in model.files


def test_the_key_in_what_a_server_writes_is_in_no_report(tmp_path, monkeypatch):
    """Some servers write the key that they were asked with into their tilesets."""
    monkeypatch.setenv("TILES_KEY", KEY)
    monkeypatch.setenv("URBANTWIN_TILE_CACHE", str(tmp_path / "kept"))
    uris = (f"{KEY}/a.glb", f"{KEY}/gone.glb", f"ftp://host/{KEY}", f"http://{KEY}.example/b.glb")
    pages = {"/t.json": tileset(tmp_path, children(*uris)), f"/{KEY}/a.glb": square()}
    with serving(pages) as server:
        model = read(f"{server.url}/t.json", key_env="TILES_KEY")
        assert len(model.mesh.faces) == 1
        assert len(model.problems) == 3
        assert KEY not in everything(model)
        monkeypatch.delenv("URBANTWIN_TILE_CACHE")
        pages["/t.json"] = tileset(tmp_path, children(*uris[1:]))
        with pytest.raises(InputError) as caught:
            read(f"{server.url}/t.json", key_env="TILES_KEY")
    assert KEY not in str(caught.value)
    kept = [path for path in (tmp_path / "kept").rglob("*") if path.is_file()]
    assert len(kept) == 1
    assert not any(KEY in str(path) or KEY.encode() in path.read_bytes() for path in kept)


def test_a_key_written_into_the_address_goes_nowhere_else(tmp_path):
    with serving({"/far.glb": square()}) as other:
        far = f"{other.url}/far.glb?token={KEY}&v=1"
        with serving({"/t.json": tileset(tmp_path, children(far))}) as server:
            read(f"{server.url}/t.json?token={KEY}", origins=[other.url])
    assert other.log == [("/far.glb", {"v": "1"}, None)]


def test_a_tile_beyond_the_limit_is_a_problem(tmp_path, monkeypatch):
    limits = Limits(20_000, 1 << 30, 600.0)
    monkeypatch.setattr("urbantwin.io.tiles3d.web.LIMITS", limits)
    pages = {
        "/t.json": tileset(tmp_path, children("a.glb", "big.glb")),
        "/a.glb": square(),
        "/big.glb": square() + bytes(20_000),
    }
    with serving(pages) as server:
        model = read(f"{server.url}/t.json")
        assert model.problems == ("big.glb: is larger than 0.02 MB",)
        short = Limits(20_000, 1000, 600.0)
        monkeypatch.setattr("urbantwin.io.tiles3d.web.LIMITS", short)
        with pytest.raises(InputError, match=r"needs more than .* a larger geometric_error_m"):
            read(f"{server.url}/t.json")


def test_a_cache_that_cannot_be_used_is_one_line(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("URBANTWIN_TILE_CACHE", str(tmp_path / "file"))
    pages = {"/t.json": tileset(tmp_path, children("a.glb")), "/a.glb": square()}
    with serving(pages) as server:
        with pytest.raises(InputError, match=r"cannot be written .*URBANTWIN_TILE_CACHE"):
            read(f"{server.url}/t.json")
        monkeypatch.setenv("URBANTWIN_TILE_CACHE", str(tmp_path / "kept"))
        read(f"{server.url}/t.json")
        some = next(path for path in (tmp_path / "kept").rglob("*") if path.is_file())
        forgotten, other = (some.with_name(f"{some.name}.{k}.part") for k in (1, 2))
        for path in (forgotten, other):
            path.write_text("half")
        os.utime(forgotten, (0, 0))
        some.unlink()
        read(f"{server.url}/t.json")
    assert some.is_file()
    assert other.is_file()
    assert not forgotten.exists()


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ({"url": "https://h/t.json", "origins": ["h2"]}, "is 'h2', which is not an origin"),
        ({"url": "https://h/t.json", "origins": ["https://h/x"]}, "which is not an origin"),
        ({"url": "https://h/t.json", "origins": ["https://a:b@h"]}, "an address, which is no"),
        ({"url": "https://h/t.json", "origins": ["ftp://h"]}, "which is not an origin"),
        ({"url": "https://h/t.json", "origins": ["http://h"]}, "'http://h' of http"),
        ({"file": "a.json", "origins": ["https://h"]}, "has origins without a url"),
    ],
)
def test_origins_that_are_none(spec, words):
    with pytest.raises(ValidationError, match=words):
        GeometrySpec(**spec)


def test_a_token_that_is_no_header_is_refused(monkeypatch):
    monkeypatch.setenv("ION_TOKEN", f"{KEY}\r\nHost: other")
    with pytest.raises(
        InputError, match="ION_TOKEN holds characters that an HTTP header must not have"
    ) as caught:
        read("http://127.0.0.1:9/t.json", key_env="ION_TOKEN")
    assert KEY not in str(caught.value)


def test_an_address_with_a_password_is_refused_without_it(tmp_path):
    with pytest.raises(InputError, match="a name or a password") as caught:
        read("https://me:pa55@127.0.0.1/t.json")
    assert "pa55" not in str(caught.value)
