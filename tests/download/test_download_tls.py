"""Requests over TLS: certificates, redirects that would leave it, slow servers, proxies."""

import socket
import ssl
import subprocess
import threading
import time

import pytest

from urbantwin.download import Client, DownloadError, Limits, parse_origin
from urbantwin.download import client as client_module
from urbantwin.download import connection as connection_module

from .local_server import OK, moved, plain, serving

SMALL = Limits(100_000, 1 << 30, 600.0)


@pytest.fixture(autouse=True)
def here_and_now(monkeypatch):
    monkeypatch.setattr(client_module, "PAUSE_S", 0.001)
    for name in ("http_proxy", "https_proxy", "all_proxy", "no_proxy"):
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.upper(), raising=False)


@pytest.fixture(scope="module")
def certificate(tmp_path_factory):
    """A certificate of 127.0.0.1 and tiles.example with its key, signed by itself."""
    folder = tmp_path_factory.mktemp("tls")
    line = (
        "openssl req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=tiles.example"
        " -addext subjectAltName=IP:127.0.0.1,DNS:tiles.example -keyout key.pem -out own.pem"
    )
    try:
        subprocess.run(line.split(), cwd=folder, check=True, capture_output=True, timeout=60)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("openssl is not here")
    return folder / "own.pem", folder / "key.pem"


@pytest.fixture
def tls(certificate, monkeypatch):
    """How a server speaks that the system trusts."""
    monkeypatch.setenv("SSL_CERT_FILE", str(certificate[0]))
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(*certificate)
    return context


def test_https_is_asked_and_told_the_key(tls):
    with serving({"/a": plain(b"safe")}, tls=tls) as server:
        assert Client(f"{server.url}/t", SMALL, key="s3cret").get(f"{server.url}/a") == b"safe"
        assert server.paths == ["/a?key=s3cret"]


def test_no_redirect_leads_from_https_to_http(tls):
    with serving({"/b": plain(b"open")}) as other, serving({}, tls=tls) as server:
        server.answers["/a"] = moved(f"{other.url}/b")
        one = Client(server.url, SMALL, origins=[parse_origin(other.url)], key="s3cret")
        with pytest.raises(DownloadError, match="redirects from https to http"):
            one.get(f"{server.url}/a")
        assert not other.heard


def test_http_and_https_are_two_origins(tls):
    with serving({"/b": plain(b"safe")}, tls=tls) as other, serving({}) as server:
        server.answers["/a"] = moved(f"{other.url}/b")
        with pytest.raises(DownloadError, match="redirects to https://127"):
            Client(server.url, SMALL).get(f"{server.url}/a")
        one = Client(server.url, SMALL, origins=[parse_origin(other.url)], key="s3cret")
        assert one.get(f"{server.url}/a") == b"safe"
        assert other.paths == ["/b"]


def test_a_certificate_that_nobody_vouches_for_is_refused(tls, monkeypatch):
    with serving({"/a": plain(b"?")}, tls=tls) as server:
        monkeypatch.delenv("SSL_CERT_FILE")
        with pytest.raises(DownloadError, match="SSLCertVerificationError"):
            Client(server.url, SMALL, key="s3cret").get(f"{server.url}/a")
        assert not server.heard


def test_a_certificate_of_somebody_else_is_refused(tls):
    with serving({"/a": plain(b"?")}, tls=tls) as server:
        root = f"https://localhost:{server.port}"
        with pytest.raises(DownloadError, match="SSLCertVerificationError"):
            Client(root, SMALL, key="s3cret").get(f"{root}/a")
        assert not server.heard


@pytest.mark.parametrize("head", [OK + b"Content-Length: 90000\r\n\r\n", OK + b"X: "])
def test_a_server_that_trickles_over_tls_is_left(tls, monkeypatch, head):
    monkeypatch.setattr(connection_module, "GRACE_S", 0.6)

    def drip(connection):
        connection.sendall(head)
        while True:
            connection.sendall(b"x")
            time.sleep(0.02)

    with serving({"/a": drip}, tls=tls) as server:
        start = time.monotonic()
        with pytest.raises(DownloadError, match="too slowly"):
            Client(server.url, SMALL).get(f"{server.url}/a")
        assert time.monotonic() - start < 3.0


def test_a_server_that_never_greets_is_left(monkeypatch):
    monkeypatch.setattr(connection_module, "QUIET_S", 0.2)
    monkeypatch.setattr(client_module, "TRIES", 1)
    with socket.create_server(("127.0.0.1", 0)) as mute:
        url = f"https://127.0.0.1:{mute.getsockname()[1]}"
        start = time.monotonic()
        with pytest.raises(DownloadError, match="no answer in time"):
            Client(url, SMALL).get(f"{url}/a")
        assert time.monotonic() - start < 3.0


def test_a_proxy_hands_tls_on_and_sees_neither_key_nor_path(tls, monkeypatch):
    with serving({"/a": plain(b"through")}, tls=tls) as server, serving({}) as proxy:

        def tunnel(connection):
            with socket.create_connection(("127.0.0.1", server.port)) as further:
                connection.sendall(b"HTTP/1.1 200 Connected\r\n\r\n")

                def back():
                    while data := further.recv(65536):
                        connection.sendall(data)
                    connection.shutdown(socket.SHUT_WR)

                thread = threading.Thread(target=back)
                thread.start()
                while data := connection.recv(65536):
                    further.sendall(data)
                further.shutdown(socket.SHUT_WR)
                thread.join(10)

        proxy.answers["tiles.example:443"] = tunnel
        monkeypatch.setenv("https_proxy", f"127.0.0.1:{proxy.port}")
        one = Client("https://tiles.example/t", SMALL, key="s3cret")
        assert one.get("https://tiles.example/a") == b"through"
        assert server.paths == ["/a?key=s3cret"]
        assert len(proxy.heard) == 1
        assert "s3cret" not in proxy.heard[0]
