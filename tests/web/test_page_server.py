"""The server as a stranger meets it: raw HTTP."""

import http.client
import socket
from pathlib import Path
from urllib.parse import urlsplit

import pytest

import urbantwin as ut
from urbantwin.errors import InputError

pytestmark = pytest.mark.usefixtures("built_page")


@pytest.fixture(scope="module")
def page(dataset, built_page):
    with ut.view(dataset, frames="0:3", progress=False, browser=False) as shown:
        yield shown


@pytest.fixture(scope="module")
def ask(page):
    """What a request is answered: status, headers, body."""
    address = urlsplit(page.address)

    def asked(path, method="GET", headers=None, inside=True):
        connection = http.client.HTTPConnection(address.hostname, address.port, timeout=20)
        given = {"Host": address.netloc, **(headers or {})}
        connection.putrequest(method, (address.path if inside else "") + path, skip_host=True)
        for name, value in given.items():
            if value is not None:
                connection.putheader(name, value)
        connection.endheaders()
        answer = connection.getresponse()
        found = answer.status, {k.lower(): v for k, v in answer.getheaders()}, answer.read()
        connection.close()
        return found

    return asked


def test_only_this_machine_is_served(page):
    address = urlsplit(page.address)
    assert address.hostname == "127.0.0.1"
    token = address.path.strip("/")
    assert len(token) == 32
    assert set(token) <= set("0123456789abcdef")
    rows = [line.split() for line in Path("/proc/net/tcp").read_text(encoding="utf-8").splitlines()]
    mine = {
        row[1].split(":")[0]
        for row in rows
        if row[1].endswith(f":{address.port:04X}") and row[3] == "0A"
    }
    assert mine == {"0100007F"}


def test_the_page_comes_with_what_browsers_may_do(ask):
    status, headers, body = ask("")
    assert status == 200
    assert headers["content-type"] == "text/html; charset=utf-8"
    policy = dict(
        part.strip().split(" ", 1) for part in headers["content-security-policy"].split(";")
    )
    assert policy["default-src"] == policy["base-uri"] == policy["frame-ancestors"] == "'none'"
    assert policy["script-src"] == policy["connect-src"] == "'self'"
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["cross-origin-resource-policy"] == "same-origin"
    assert "access-control-allow-origin" not in headers
    assert "server" not in headers
    assert b'<script src="page.js">' in body


def test_who_does_not_know_the_token_gets_nothing(ask, page):
    token = urlsplit(page.address).path.strip("/")
    wrong = ("0" if token[0] != "0" else "1") + token[1:]
    for path in ("/", "/page.js", "/document.json", f"/{wrong}/", f"/{wrong}/packet/points/0/0",
                 "/packet/points/0/0", f"/{token[:-1]}/", f"//{token[:-1]}/"):  # fmt: skip
        status, headers, body = ask(path, inside=False)
        assert status == 404, path
        assert token.encode() not in body
        assert token not in str(headers)
        assert "content-security-policy" in headers


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:80", "127.0.0.1", "localhost:1", "", None]
)
def test_other_names_are_refused(ask, host):
    status, _, body = ask("packet/points/0/0", headers={"Host": host})
    assert status in (400, 421)
    assert len(body) < 100


def test_localhost_is_this_machine(ask, page):
    port = urlsplit(page.address).port
    assert ask("", headers={"Host": f"localhost:{port}"})[0] == 200


@pytest.mark.parametrize(
    "path",
    ["packet/../../../../etc/passwd", "packet/..%2f..%2fetc%2fpasswd", "../", "packet/%00",
     "packet/", "page.js/", "packet/points/0/99", "packet/points/%D9%A3/0", "page.py"],
)  # fmt: skip
def test_nothing_else_is_there(ask, path):
    assert ask(path)[0] == 404


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "PATCH", "TRACE"])
def test_nothing_can_be_written(ask, method):
    status, headers, _ = ask("packet/points/0/0", method)
    assert status in (404, 405)
    assert "access-control-allow-origin" not in headers


def test_ranges_are_right_to_the_byte(ask, page):
    whole = page.packet("points/0/0")
    size = len(whole)
    status, headers, body = ask("packet/points/0/0")
    assert (status, body, headers["accept-ranges"]) == (200, whole, "bytes")
    assert headers["cache-control"].startswith("private")
    for asked, first, last in (
        ("0-0", 0, 0), ("0-99", 0, 99), ("100-", 100, size - 1), ("-10", size - 10, size - 1),
        (f"{size - 1}-", size - 1, size - 1), (f"5-{size * 2}", 5, size - 1),
        (f"-{size * 2}", 0, size - 1),
    ):  # fmt: skip
        status, headers, body = ask("packet/points/0/0", headers={"Range": f"bytes={asked}"})
        assert (status, body) == (206, whole[first : last + 1]), asked
        assert headers["content-range"] == f"bytes {first}-{last}/{size}"
        assert headers["content-length"] == str(last - first + 1)
    for asked in (f"{size}-", f"{10 * size}-{11 * size}", "-0"):
        status, headers, body = ask("packet/points/0/0", headers={"Range": f"bytes={asked}"})
        assert (status, body, headers["content-range"]) == (416, b"", f"bytes */{size}"), asked
    for asked in (
        "bytes=0-1,5-6",
        "lines=0-1",
        "bytes=x-1",
        "bytes=9-3",
        "bytes=-",
        "bytes=" + "9" * 400 + "-",
    ):
        status, _, body = ask("packet/points/0/0", headers={"Range": asked})
        assert status in (200, 416), asked
        assert body in (whole, b"")


def test_a_tag_saves_what_is_known(ask):
    _, headers, _ = ask("packet/boxes/0/1")
    tag = headers["etag"]
    assert ask("packet/boxes/0/1", headers={"If-None-Match": tag})[::2] == (304, b"")
    assert ask("packet/boxes/0/2", headers={"If-None-Match": tag})[0] == 200
    changed = {"Range": "bytes=0-3", "If-Range": '"other"'}
    assert ask("packet/boxes/0/1", headers=changed)[0] == 200
    assert ask("packet/boxes/0/1", headers={**changed, "If-Range": tag})[0] == 206


def test_head_is_get_without_the_body(ask):
    status, headers, body = ask("packet/points/0/0", "HEAD")
    other = ask("packet/points/0/0")
    assert (status, body) == (200, b"")
    assert headers["content-length"] == str(len(other[2]))
    assert headers["etag"] == other[1]["etag"]


def test_nonsense_does_not_end_it(ask, page):
    address = urlsplit(page.address)
    for said in (b"\x00" * 100, b"GET\r\n\r\n", b"GET / HTTP/9.9\r\n\r\n", b"A" * 100_000):
        with socket.create_connection((address.hostname, address.port), timeout=5) as stream:
            stream.sendall(said)
            stream.shutdown(socket.SHUT_WR)
            while stream.recv(65536):
                pass
    assert ask("")[0] == 200


def test_a_port_in_use_is_said(dataset, page):
    port = urlsplit(page.address).port
    with pytest.raises(InputError, match=f"port: {port} cannot be had"):
        ut.view(dataset, port=port, progress=False, browser=False)
    for wrong in (-1, 65536):
        with pytest.raises(InputError, match="0 to 65535"):
            ut.view(dataset, port=wrong, progress=False, browser=False)


def test_a_closed_page_is_gone(dataset):
    shown = ut.view(dataset, frames="0:1", progress=False, browser=False)
    address = urlsplit(shown.address)
    shown.close()
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection((address.hostname, address.port), timeout=5)
