"""Who is asked, who is told the key, and how much and how long a server may answer."""

import contextlib
import gzip
import socket
import threading
import time
import tracemalloc
import zlib

import numpy as np
import pytest

from urbantwin.download import Client, DownloadError, Limits, parse_origin
from urbantwin.download import client as client_module
from urbantwin.download import connection as connection_module

from .local_server import OK, moved, plain, serving

KEY = "s3cret/key+"
SMALL = Limits(100_000, 1 << 30, 600.0)


@pytest.fixture(autouse=True)
def here_and_now(monkeypatch):
    """No pauses, and no proxies of whoever runs the tests."""
    monkeypatch.setattr(client_module, "PAUSE_S", 0.001)
    for name in ("http_proxy", "https_proxy", "all_proxy", "no_proxy"):
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.upper(), raising=False)


def client(root, origins=(), limits=SMALL, **more):
    return Client(root, limits, origins=[parse_origin(text) for text in origins], **more)


def refused(one, address, words):
    with pytest.raises(DownloadError) as caught:
        one.get(address)
    said = str(caught.value)
    assert words in said
    assert "\n" not in said
    assert KEY not in said
    assert "s3cret" not in said
    return caught.value


def test_another_port_is_another_origin_and_asked_only_if_listed():
    with serving({"/a": plain(b"other")}) as other, serving({"/a": plain(b"root")}) as server:
        one = client(server.url)
        assert one.get(f"{server.url}/a") == b"root"
        refused(one, f"{other.url}/a", f"it lies at {other.url}, which is not the root's origin")
        assert not other.heard
        assert client(server.url, [other.url]).get(f"{other.url}/a") == b"other"


@pytest.mark.parametrize("told", ["key", "bearer"])
def test_the_key_reaches_the_root_and_no_other_port(told):
    with serving({}) as other:
        other.answers |= {"/b": plain(b"there"), "/c": plain(b"there")}
        answers = {
            "/a": plain(b"here"),
            "/go": moved(f"{other.url}/b?x=1&key=s3cret%2Fkey%2B&y=s3cret/key%2b"),
            "/on": moved("/a?style=2"),
        }
        with serving(answers) as server:
            one = client(f"{server.url}/root", [other.url], **{told: KEY})
            assert one.get(f"{server.url}/a?key=old&z=2") == b"here"
            assert one.get(f"{server.url}/go") == b"there"
            assert one.get(f"{other.url}/c?key=s3cret%252Fkey%252B") == b"there"
            assert one.get(f"{server.url}/on") == b"here"
    assert all("s3cret" not in heard for heard in other.heard)
    assert [path.split("?")[0] for path in other.paths] == ["/b", "/c"]
    assert "x=1" in other.paths[0]
    if told == "key":
        assert server.paths == [
            "/a?z=2&key=s3cret%2Fkey%2B",
            "/go?key=s3cret%2Fkey%2B",
            "/on?key=s3cret%2Fkey%2B",
            "/a?style=2&key=s3cret%2Fkey%2B",
        ]
    else:
        assert all(f"Authorization: Bearer {KEY}\r\n" in heard for heard in server.heard)


def test_a_redirect_with_the_key_in_its_path_is_not_followed():
    with serving({}) as other, serving({}) as server:
        server.answers["/a"] = moved(f"{other.url}/s3cret%2fkey+/tile")
        refused(client(server.url, [other.url], key=KEY), f"{server.url}/a", "the key would go")
        server.answers["/b"] = moved("http://s3cret-key.example/tile")
        one = client(server.url, key="s3cret-key")
        said = str(refused(one, f"{server.url}/b", "redirects to another origin"))
        assert "example" not in said
        assert not other.heard


@pytest.mark.parametrize("status", [301, 302, 303, 307, 308])
def test_a_redirect_elsewhere_is_held_to_the_same_rule(status):
    with serving({"/b": plain(b"stolen")}) as other, serving({}) as server:
        server.answers["/a"] = moved(f"{other.url}/b", status)
        one = client(server.url, key=KEY)
        refused(one, f"{server.url}/a", f"it redirects to {other.url}, which is not")
        assert not other.heard
        assert len(server.heard) == 1


@pytest.mark.parametrize(
    "where",
    ["file:///etc/passwd", "ftp://127.0.0.1/a", "http://user:pw@127.0.0.1/", "gopher:x"],
)
def test_a_redirect_to_no_address_of_http_is_refused(where):
    with serving({"/a": moved(where)}) as server:
        one = client(server.url)
        with pytest.raises(DownloadError, match="refused"):
            one.get(f"{server.url}/a")
        assert len(server.heard) == 1


def test_redirects_end():
    with serving({"/a": moved("/b"), "/b": moved("/a")}) as server:
        refused(client(server.url), f"{server.url}/a", "redirected more than 5 times")
        assert len(server.heard) == 6
        for k in range(5):
            server.answers[f"/{k}"] = moved(f"{k + 1}")
        server.answers["/5"] = plain(b"at last")
        assert client(server.url).get(f"{server.url}/0") == b"at last"


def names(monkeypatch, **numbers):
    """Let names stand for numbers, in turn where there are several; the last one stays."""
    real = socket.getaddrinfo

    def lookup(host, port, *args, **more):
        if host in numbers:
            known = numbers[host]
            host = known.pop(0) if len(known) > 1 else known[0]
            if host is None:
                raise socket.gaierror(-2, "Name or service not known")
        elif host.endswith((".example", ".invalid")):
            raise socket.gaierror(-2, "Name or service not known")
        return real(host, port, *args, **more)

    monkeypatch.setattr(socket, "getaddrinfo", lookup)


def nowhere(monkeypatch):
    """Fail every test that would leave this machine."""
    real = socket.socket.connect

    def connect(self, address):
        assert address[0] in ("127.0.0.1", "::1"), f"a connection to {address}"
        return real(self, address)

    monkeypatch.setattr(connection_module._Plain, "connect", connect, raising=False)


PUBLIC = "93.184.216.34"


@pytest.mark.parametrize(
    "numbers",
    [
        "127.0.0.1", "10.1.2.3", "172.16.0.1", "192.168.1.1", "169.254.169.254", "0.0.0.0",
        "100.64.0.1", "224.0.0.1", "255.255.255.255", "240.0.0.1", "192.0.2.1", "198.18.0.1",
        "::1", "::", "fe80::1", "fc00::1", "fec0::1", "ff02::1", "2001:db8::1", "::ffff:127.0.0.1",
        "::ffff:10.0.0.1", "::127.0.0.1", "2002:7f00:1::", "64:ff9b::7f00:1", "64:ff9b:1::a00:1",
        "2001:0:4136:e378:8000:63bf:3fff:fdd2",
    ],
)  # fmt: skip
def test_a_public_root_leads_to_no_private_address(monkeypatch, numbers):
    nowhere(monkeypatch)
    names(monkeypatch, **{"root.example": [PUBLIC], "inside.example": [numbers]})
    one = client("http://root.example/t", ["http://inside.example:81"])
    refused(one, "http://inside.example:81/x", "http://inside.example:81 is a private address")


@pytest.mark.parametrize("numbers", [PUBLIC, "2606:2800:220:1::1", "64:ff9b::5db8:d822"])
def test_public_addresses_are_asked(monkeypatch, numbers):
    tried = []

    def connect(self, address):
        tried.append(address[0])
        raise ConnectionRefusedError

    monkeypatch.setattr(connection_module._Plain, "connect", connect, raising=False)
    names(monkeypatch, **{"root.example": [numbers]})
    refused(client("http://root.example/"), "http://root.example/", "(nobody listens there)")
    assert tried == [numbers] * client_module.TRIES


@pytest.mark.parametrize(
    "host",
    ["2130706433", "0x7f000001", "0177.0.0.1", "127.1", "0", "localhost", "localhost.", "[::1]",
     "[::ffff:7f00:1]", "LOCALHOST", "１２７.0.0.1"],
)  # fmt: skip
def test_odd_spellings_of_this_machine_are_no_way_in(monkeypatch, host):
    with serving({"/x": plain(b"inside")}) as inside:
        nowhere(monkeypatch)
        names(monkeypatch, **{"root.example": [PUBLIC], "localhost.": ["127.0.0.1"]})
        origin = f"http://{host}:{inside.port}"
        one = client("http://root.example/t", [origin])
        with pytest.raises(DownloadError, match="is a private address"):
            one.get(f"{origin}/x")
        assert not inside.heard
    with pytest.raises(DownloadError, match="not the root's origin"):
        client("http://root.example/t").get(f"{origin}/x")


def test_a_name_that_changes_its_numbers_leads_nowhere_else(monkeypatch):
    """DNS rebinding: public when first asked, this machine the next time."""
    with serving({"/x": plain(b"inside")}) as inside:
        root = f"http://root.example:{inside.port}"
        names(monkeypatch, **{"root.example": [PUBLIC, "127.0.0.1"]})
        refused(client(root), f"{root}/x", "is a private address")
        names(monkeypatch, **{"root.example": [PUBLIC, PUBLIC, "127.0.0.1"]})
        monkeypatch.setattr(client_module, "TRIES", 1)
        tried = []

        def connect(self, address):
            tried.append(address[0])
            raise ConnectionRefusedError

        monkeypatch.setattr(connection_module._Plain, "connect", connect, raising=False)
        refused(client(root), f"{root}/x", "(nobody listens there)")
        assert tried == [PUBLIC]
        assert not inside.heard


def test_a_private_root_is_asked_and_so_are_private_ones_that_it_lists(monkeypatch):
    names(monkeypatch, **{"tiles.example": ["127.0.0.1"]})
    with serving({"/x": plain(b"other")}) as other, serving({"/x": plain(b"root")}) as server:
        root = f"http://tiles.example:{server.port}"
        assert client(f"{root}/t").get(f"{root}/x") == b"root"
        assert client(f"{root}/t", [other.url]).get(f"{other.url}/x") == b"other"
        refused(client(f"{root}/t"), f"{other.url}/x", "not the root's origin")


def test_numbers_of_ipv6_as_root():
    try:
        with serving({"/x": plain(b"six")}, socket.AF_INET6) as server:
            root = f"http://[0:0::1]:{server.port}"
            assert client(root).get(f"http://[::1]:{server.port}/x") == b"six"
            assert f"Host: [::1]:{server.port}\r\n" in server.heard[0]
    except OSError:
        pytest.skip("no IPv6 here")


def test_a_name_that_nobody_knows(monkeypatch):
    names(monkeypatch)
    refused(
        client("http://gone.invalid/"),
        "http://gone.invalid/",
        "(there is no network, or no host of this name)",
    )


# What a server may do to us.


def drip(head: bytes, byte: bytes):
    def answer(connection):
        connection.sendall(head)
        while True:
            connection.sendall(byte)
            time.sleep(0.02)

    return answer


@pytest.mark.parametrize(
    ("head", "byte"),
    [
        (OK + b"Content-Length: 90000\r\n\r\n", b"x"),
        (OK + b"X: ", b"x"),
        (b"", b"H"),
        (OK, b"X: y\r\n"),
        (OK + b"Transfer-Encoding: chunked\r\n\r\n", b"1\r\nx\r\n"),
        (b"", b"HTTP/1.1 100 Continue\r\n\r\n"),
    ],
)
def test_a_server_that_trickles_is_left(monkeypatch, head, byte):
    monkeypatch.setattr(connection_module, "GRACE_S", 0.6)
    with serving({"/a": drip(head, byte)}) as server:
        start = time.monotonic()
        refused(client(server.url), f"{server.url}/a", "it comes too slowly")
        assert time.monotonic() - start < 3.0
        assert len(server.heard) == 1


def test_a_server_that_says_nothing_is_left(monkeypatch):
    monkeypatch.setattr(connection_module, "QUIET_S", 0.2)
    done = threading.Event()
    with serving({"/a": lambda connection: done.wait(10)}) as server:
        start = time.monotonic()
        refused(client(server.url), f"{server.url}/a", "(no answer in time)")
        assert time.monotonic() - start < 5.0
        done.set()
    assert len(server.heard) == client_module.TRIES


def endless(head: bytes, part: bytes):
    def answer(connection):
        connection.sendall(head)
        while True:
            connection.sendall(part)

    return answer


@pytest.mark.parametrize(
    "answer",
    [
        plain(b"x" * 100_001),
        OK + b"Content-Length: 99999999999\r\n\r\nx",
        endless(OK + b"\r\n", b"x" * 65536),
        endless(OK + b"Transfer-Encoding: chunked\r\n\r\n", b"10000\r\n" + b"x" * 65536 + b"\r\n"),
        plain(gzip.compress(bytes(100_001), mtime=0), "Content-Encoding: gzip"),
        plain(gzip.compress(bytes(90_000), mtime=0) * 2, "Content-Encoding: x-gzip"),
    ],
)
def test_what_is_too_large_is_refused_while_it_comes(answer):
    with serving({"/a": answer}) as server:
        refused(client(server.url), f"{server.url}/a", "is larger than 0.1 MB")
        assert len(server.heard) == 1


@pytest.mark.parametrize(
    "answer",
    [
        endless(OK, b"X: y\r\n" * 1000),
        endless(OK + b"X: ", b"x" * 65536),
        endless(b"", b"HTTP/1.1 100 Continue\r\n\r\n" * 1000),
        endless(OK + b"Transfer-Encoding: chunked\r\n\r\n1\r\nx\r\n0\r\n", b"X: y\r\n" * 1000),
        endless(OK + b"Transfer-Encoding: chunked\r\n\r\n-1\r\n", b"x" * 65536),
        endless(OK + b"Transfer-Encoding: chunked\r\n\r\n1;", b"x" * 65536),
        endless(b"", b"x" * 65536),
    ],
)
def test_endless_headers_end(answer):
    with serving({"/a": answer}) as server:
        start = time.monotonic()
        with pytest.raises(DownloadError):
            client(server.url).get(f"{server.url}/a")
        assert time.monotonic() - start < 5.0


def test_a_bomb_of_gzip_takes_no_memory():
    machine = zlib.compressobj(9, wbits=31)
    bomb = b"".join(machine.compress(bytes(1 << 20)) for _ in range(100)) + machine.flush()
    limits = Limits(1 << 20, 1 << 30, 600.0)
    with serving({"/a": plain(bomb, "Content-Encoding: gzip")}) as server:
        tracemalloc.start()
        refused(client(server.url, limits=limits), f"{server.url}/a", "is larger than 1 MiB")
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert peak < 16 << 20


@pytest.mark.parametrize("length", ["x", "-1", "1_0", "+5", "5, 5", "", "0x5", "٥", "9" * 5000])
def test_a_length_that_is_none_is_refused(length):
    answer = OK + f"Content-Length: {length}\r\n\r\nhello".encode()
    with serving({"/a": answer}) as server, pytest.raises(DownloadError) as caught:
        client(server.url).get(f"{server.url}/a")
    assert "Content-Length is no length" in str(caught.value)


def test_lengths_that_contradict_each_other_are_refused():
    answer = OK + b"Content-Length: 5\r\nContent-Length: 3\r\n\r\nhello"
    with serving({"/a": answer}) as server:
        refused(client(server.url), f"{server.url}/a", "Content-Length is no length")


@pytest.mark.parametrize(
    "answer",
    [
        OK + b"Content-Length: 9\r\n\r\nhello",
        OK + b"Transfer-Encoding: chunked\r\n\r\n9\r\nhello",
        plain(gzip.compress(b"hello" * 50, mtime=0)[:-9], "Content-Encoding: gzip"),
    ],
)
def test_an_answer_that_ends_early_is_asked_for_again(answer):
    with serving({"/a": [answer, plain(b"hello")]}) as server:
        assert client(server.url).get(f"{server.url}/a") == b"hello"
        assert len(server.heard) == 2


def test_answers_are_unpacked():
    text = b"what it says " * 100
    packed = gzip.compress(text[:700]) + gzip.compress(text[700:])
    answers = {
        "/a": plain(packed, "Content-Encoding: gzip"),
        "/b": OK + b"Transfer-Encoding: chunked\r\n\r\n3\r\nabc\r\n2\r\nde\r\n0\r\n\r\n",
        "/c": OK + b"\r\nto the end",
        "/d": plain(b"", "Content-Encoding: gzip"),
        "/e": plain(b"?", "Content-Encoding: br"),
        "/f": plain(b"no gzip", "Content-Encoding: gzip"),
    }
    with serving(answers) as server:
        one = client(server.url)
        got = [one.get(f"{server.url}/{name}") for name in "abcd"]
        assert got == [text, b"abcde", b"to the end", b""]
        refused(one, f"{server.url}/e", "in a way that was not requested")
        refused(one, f"{server.url}/f", "cannot be unpacked")


def test_all_that_is_downloaded_has_limits():
    with serving({"/a": plain(b"x" * 60_000)}) as server:
        one = client(server.url, limits=Limits(100_000, 100_000, 600.0))
        one.get(f"{server.url}/a")
        assert refused(one, f"{server.url}/a", "needs more than").spent
        assert refused(one, f"{server.url}/a", "altogether").spent
        assert len(server.heard) == 2
        one = client(server.url, limits=Limits(100_000, 1 << 30, -1.0))
        assert refused(one, f"{server.url}/a", "takes longer than").spent


def test_a_server_that_is_dead_is_given_up():
    with serving({}) as server:
        url = server.url
    one = client(url)
    for _ in range(client_module.PATIENCE // client_module.TRIES):
        refused(one, f"{url}/a", "(nobody listens there)")
    refused(one, f"{url}/a", "the server no longer answers")


def test_a_proxy_is_asked_and_told_no_private_address(monkeypatch):
    with serving({}) as proxy:
        proxy.answers["http://tiles.example/a"] = plain(b"by proxy")
        proxy.answers["http://tiles.example/b"] = moved("http://10.0.0.1/x")
        monkeypatch.setenv("http_proxy", f"http://me:pass@127.0.0.1:{proxy.port}")
        one = client("http://tiles.example/t", ["http://10.0.0.1", "http://2130706433"], key=KEY)
        assert one.get("http://tiles.example/a") == b"by proxy"
        assert "Proxy-Authorization: Basic bWU6cGFzcw==\r\n" in proxy.heard[0]
        assert "Host: tiles.example\r\n" in proxy.heard[0]
        refused(one, "http://tiles.example/b", "http://10.0.0.1 is a private address")
        refused(one, "http://2130706433/", "is a private address")
        assert len(proxy.heard) == 2
        with serving({"/a": plain(b"myself")}) as server:
            assert client(server.url).get(f"{server.url}/a") == b"myself"
        assert len(proxy.heard) == 2
        monkeypatch.setenv("http_proxy", "socks5://127.0.0.1:9")
        refused(one, "http://tiles.example/a", "http_proxy names no proxy of HTTP")


@pytest.mark.parametrize(
    "text",
    ["", "x", "file:///a", "http://", "http:///a", "http://h:x/", "http://h:0/", "http://h:70000/",
     "http://a b/", "http://a\\b/", "http://{key}.b/", "http://[::1/", "http://[fe80::1%25lo]/",
     "http://[1]/", "http://" + "a" * 70 + "/", "http://a..b/", "http://u:p@h/", "http://%31/"],
)  # fmt: skip
def test_addresses_that_are_none(text):
    with pytest.raises(DownloadError):
        client(text)


def test_origins_are_compared_as_they_mean():
    same = ["http://Example.org", "http://example.org:80/", "HTTP://EXAMPLE.ORG:80"]
    assert len({parse_origin(text) for text in same}) == 1
    assert parse_origin("http://bücher.example") == parse_origin("http://xn--bcher-kva.example")
    others = ["https://example.org", "http://example.org:8080", "http://example.org."]
    assert len({parse_origin(text) for text in [same[0], *others]}) == 4
    for text in (
        "example.org",
        "http://h/path",
        "http://h?x",
        "http://u@h",
        "http://h#a",
        "ftp://h",
    ):
        with pytest.raises(DownloadError):
            parse_origin(text)


def test_damaged_answers_are_one_kind_of_error(monkeypatch):
    monkeypatch.setattr(connection_module, "GRACE_S", 0.5)
    monkeypatch.setattr(client_module, "TRIES", 1)
    random = np.random.default_rng(7)
    body = gzip.compress(b"tile" * 99, mtime=0)
    seeds = [
        plain(body, "Content-Encoding: gzip", "Content-Type: image/png"),
        OK + b"Transfer-Encoding: chunked\r\n\r\n5\r\nhello\r\n3;a=b\r\nyou\r\n0\r\nX: y\r\n\r\n",
        moved("/a?b=c#d"),
    ]
    with serving({}) as server:
        for turn in range(300):
            data = bytearray(seeds[turn % 3])
            for at in random.integers(0, len(data), 1 + turn % 4):
                data[at] = random.choice([0, 10, 13, 45, 57, 255, random.integers(256)])
            cut = random.integers(1, len(data)) if turn % 5 == 0 else len(data)
            server.answers["/a"] = bytes(data[:cut])
            with contextlib.suppress(DownloadError):
                assert len(client(server.url).get(f"{server.url}/a")) < 1000
