"""Server of a page, on this machine only, protected by a token in its address."""

from __future__ import annotations

import hashlib
import logging
import os
import re
import secrets
import socket
from collections.abc import Callable
from threading import Event, Semaphore, Thread

import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from urbantwin.errors import InputError, UrbanTwinError
from urbantwin.web.page_document import POLICY, json_for_script, page_file, served_html
from urbantwin.web.shown import Shown

__all__ = ["PageServer"]

_HOST = "127.0.0.1"
_HEADERS = {
    "content-security-policy": POLICY,
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "permissions-policy": "camera=(), microphone=(), geolocation=()",
}
_RANGE = re.compile(r"bytes=(\d*)-(\d*)", re.ASCII)


class PageServer:
    """Serves a page from its creation until `close`.

    Args:
        shown: content of the page.
        port: port; 0 for any free one.

    Attributes:
        address: address of the page, with its secret token.

    Raises:
        InputError: the page is not built, or the port is not available.
    """

    def __init__(self, shown: Shown, port: int = 0) -> None:
        script, style = page_file("page.js"), page_file("page.css")
        self._socket = _bound(port)
        self.port = int(self._socket.getsockname()[1])
        token = secrets.token_hex(16)
        self.address = f"http://{_HOST}:{self.port}/{token}/"
        self._closing = Event()
        application = _application(shown, token, script, style, self._closing)
        config = uvicorn.Config(
            _Guarded(application, self.port),
            log_config=None,
            access_log=False,
            server_header=False,
            date_header=False,
            lifespan="off",
            ws="none",
            http="h11",
            loop="asyncio",
            timeout_graceful_shutdown=1,
            timeout_keep_alive=30,
        )
        self._server = uvicorn.Server(config)
        self._thread = Thread(
            target=self._server.run, kwargs={"sockets": [self._socket]}, daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """Stop serving; running responses get a second to finish.

        uvicorn and asyncio would log a traceback for each aborted response, which is suppressed.
        """
        loggers = [logging.getLogger(name) for name in ("uvicorn.error", "asyncio")]
        for one in loggers:
            one.addFilter(_nothing)
        try:
            self._closing.set()
            self._server.should_exit = True
            self._thread.join(timeout=5)
            self._socket.close()
        finally:
            if not self._thread.is_alive():
                for one in loggers:
                    one.removeFilter(_nothing)


def _nothing(_record: logging.LogRecord) -> bool:
    return False


def _bound(port: int) -> socket.socket:
    if not 0 <= port <= 65535:
        raise InputError(f"is {port}", place="port", expected="0 to 65535; 0 for any that is free")
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((_HOST, port))
        listening.listen(64)
    except OSError as error:
        listening.close()
        what = error.strerror or str(error)
        raise InputError(
            f"{port} cannot be had ({what})", place="port", expected="one that is free, or none"
        ) from None
    return listening


def _application(
    shown: Shown, token: str, script: bytes, style: bytes, closing: Event
) -> Starlette:
    # As many simultaneous packets as processors. Other requests wait, and are rejected when the
    # server closes, which would otherwise wait for all packets that a page requested in advance.
    room = Semaphore(os.cpu_count() or 1)

    def index(request: Request) -> Response:
        return _whole(request, served_html(shown.document()), "text/html; charset=utf-8")

    def document(request: Request) -> Response:
        text = json_for_script(shown.document()).encode()
        return _whole(request, text, "application/json")

    def file(content: bytes, kind: str) -> Callable[[Request], Response]:
        return lambda request: _whole(request, content, f"{kind}; charset=utf-8")

    def packet(request: Request) -> Response:
        try:
            with room:
                if closing.is_set():
                    return PlainTextResponse("the server is closing", 503)
                content = shown.packet(request.path_params["name"])
        except KeyError:
            return PlainTextResponse("not found", 404)
        except UrbanTwinError as error:
            return PlainTextResponse(str(error), 422)
        except OSError as error:
            return PlainTextResponse(error.strerror or "cannot be read", 422)
        return _whole(request, content, "application/octet-stream", cache="private, max-age=3600")

    application = Starlette(
        routes=[
            Route(f"/{token}/", index),
            Route(f"/{token}/document.json", document),
            Route(f"/{token}/page.js", file(script, "text/javascript")),
            Route(f"/{token}/page.css", file(style, "text/css")),
            Route(f"/{token}/packet/{{name:path}}", packet),
        ]
    )
    application.router.redirect_slashes = False
    return application


def _whole(request: Request, content: bytes, kind: str, cache: str = "no-store") -> Response:
    """Return content, or its requested range (RFC 9110, section 14)."""
    tag = f'"{hashlib.sha256(content).hexdigest()[:32]}"'
    headers = {"etag": tag, "accept-ranges": "bytes", "cache-control": cache}
    if request.headers.get("if-none-match") in (tag, "*"):
        return Response(status_code=304, headers=headers)
    asked = request.headers.get("range")
    condition = request.headers.get("if-range")
    if asked is None or request.method == "HEAD" or condition not in (None, tag):
        return Response(content, 200, headers, kind)
    found = _RANGE.fullmatch(asked.strip())
    if found is None or found.group() == "bytes=-":
        return Response(content, 200, headers, kind)  # several ranges, other units: may be ignored
    first, last = (text[:19] for text in found.groups())
    size = len(content)
    if first:
        begin = int(first)
        end = min(int(last), size - 1) if last else size - 1
    else:
        begin, end = max(size - int(last), 0), size - 1
        if int(last) == 0:
            begin = size
    if last and first and int(last) < begin:
        return Response(content, 200, headers, kind)  # not a range
    if begin >= size:
        return Response(status_code=416, headers={**headers, "content-range": f"bytes */{size}"})
    headers["content-range"] = f"bytes {begin}-{end}/{size}"
    return Response(content[begin : end + 1], 206, headers, kind)


class _Guarded:
    """Rejects requests to other host names than this machine's, and sets security headers.

    A foreign name that resolves to this machine (DNS rebinding) has that name in the request.
    """

    def __init__(self, application: ASGIApp, port: int) -> None:
        self._application = application
        self._names = {f"{host}:{port}" for host in (_HOST, "localhost")}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers[name] = value
            await send(message)

        hosts = Headers(scope=scope).getlist("host")
        if len(hosts) != 1 or hosts[0].lower() not in self._names:
            await PlainTextResponse("not for this name", 421)(scope, receive, with_headers)
            return
        await self._application(scope, receive, with_headers)
