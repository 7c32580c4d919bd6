"""Tiles fetched over HTTP, with a key that goes nowhere else."""

from __future__ import annotations

import hashlib
import http.client
import os
import time
import urllib.error
import urllib.request
from collections.abc import Mapping
from pathlib import Path
from urllib.parse import parse_qsl, quote, urlencode, urljoin, urlsplit, urlunsplit

from urbantwin.errors import InputError
from urbantwin.reconstruct.gltf.malformed import MalformedError
from urbantwin.reconstruct.tiles3d.store import LARGEST_TILE
from urbantwin.site.geometry import GeometrySource

__all__ = ["Web", "open_web"]

_TIMEOUT_S = 30.0
_DEADLINE_S = 300.0
_TRIES = 4
#: Before the second try; each further pause is four times as long.
_PAUSE_S = 0.25
#: Tries in a row without any answer after which a server is given up.
_PATIENCE = 64
_CHUNK = 1 << 20
#: Parts of an address that say who asks, and not what for.
_PERSONAL = frozenset({"key", "session", "access_token", "token", "sig", "signature"})
#: Environment variable that names a folder to keep tiles in.
CACHE = "URBANTWIN_TILE_CACHE"


def open_web(source: GeometrySource, environment: Mapping[str, str] | None = None) -> Web:
    """Return the store of a source that is an address.

    The key is the value of the environment variable ``key_env``. It is sent as ``key=`` in the
    address (Google's Photorealistic 3D Tiles), or as ``Authorization: Bearer`` where the
    variable's name contains TOKEN (Cesium ion) or its value begins with "Bearer".

    Raises:
        InputError: the variable is not set, or the address is not one of HTTP.
    """
    environment = os.environ if environment is None else environment
    spec = source.spec
    url = spec.url or ""
    parts = urlsplit(url)
    if parts.scheme not in ("http", "https") or not parts.hostname:
        raise InputError(
            "is not an address of HTTP",
            file=source.document.file,
            place=source.place("url"),
            expected="https://...",
        )
    key, bearer = None, None
    if spec.key_env is not None:
        value = environment.get(spec.key_env, "").strip()
        if not value:
            raise InputError(
                f"the environment variable {spec.key_env} is not set",
                file=source.document.file,
                place=source.place("key_env"),
                expected="the address's key in it",
            )
        if value.lower().startswith("bearer "):
            bearer = value[7:].strip()
        elif "TOKEN" in spec.key_env.upper():
            bearer = value
        else:
            key = value
    cache = environment.get(CACHE)
    return Web(url, key=key, bearer=bearer, cache=Path(cache) if cache else None)


class Web:
    """Addresses of HTTP and HTTPS.

    The key goes to the root's own host only. What a parent's address asks for (``session=``) is
    handed on to its children on the same host, as Google's tiles need it.

    Args:
        url: of the root.
        key: sent as ``key=``, or ``None``.
        bearer: sent as ``Authorization: Bearer``, or ``None``.
        cache: a folder to keep what was fetched in, or ``None``.
    """

    parallel = 8

    def __init__(
        self,
        url: str,
        *,
        key: str | None = None,
        bearer: str | None = None,
        cache: Path | None = None,
    ) -> None:
        self.root = url.split("#", maxsplit=1)[0]
        self._key = key
        self._bearer = bearer
        self._cache = cache
        self._unanswered = 0
        self._home = urlsplit(self.root)
        self._opener = urllib.request.build_opener(_Redirect(self._home.hostname))

    def resolve(self, base: str, uri: str) -> str:
        """Return the address that ``uri`` means in the file at ``base``."""
        try:
            address = urljoin(base, quote(uri.strip(), safe="%/:=&?~#+!$,;'@()*[]"))
            parts, above = urlsplit(address), urlsplit(base)
            allowed = {"https"} if self._home.scheme == "https" else {"http", "https"}
            if parts.scheme not in allowed or not parts.hostname:
                raise MalformedError(f"is refused: it is not an address of {self._home.scheme}")
        except ValueError:
            raise MalformedError("is not an address") from None
        query = parse_qsl(parts.query, keep_blank_values=True)
        if parts.netloc == above.netloc:
            own = {name for name, _ in query}
            inherited = parse_qsl(above.query, keep_blank_values=True)
            query += [(name, value) for name, value in inherited if name not in own]
        return urlunsplit((parts.scheme, parts.netloc, parts.path, urlencode(query), ""))

    def fetch(self, address: str) -> bytes:
        """Return the bytes at an address; failures that may pass are tried again."""
        kept = self._kept(address)
        if kept is not None and kept.is_file():
            return kept.read_bytes()
        data = self._asked(address)
        if kept is not None:
            kept.parent.mkdir(parents=True, exist_ok=True)
            scratch = kept.with_suffix(f".{os.getpid()}.part")
            scratch.write_bytes(data)
            scratch.replace(kept)
        return data

    def name(self, address: str) -> str:
        """Return the address without what it asks for, relative to the root's folder."""
        parts = urlsplit(address)
        folder = self._home.path.rpartition("/")[0] + "/"
        if parts.netloc == self._home.netloc and parts.path.startswith(folder):
            return parts.path[len(folder) :] or parts.path
        return f"{parts.hostname}{parts.path}"

    def _kept(self, address: str) -> Path | None:
        if self._cache is None:
            return None
        parts = urlsplit(address)
        query = [(k, v) for k, v in parse_qsl(parts.query) if k.lower() not in _PERSONAL]
        plain = urlunsplit((parts.scheme, parts.netloc, parts.path, urlencode(query), ""))
        digest = hashlib.sha256(plain.encode()).hexdigest()
        return self._cache / digest[:2] / digest

    def _asked(self, address: str) -> bytes:
        parts = urlsplit(address)
        headers = {"User-Agent": "urbantwin", "Accept-Encoding": "gzip"}
        if parts.hostname == self._home.hostname:
            if self._bearer is not None:
                headers["Authorization"] = f"Bearer {self._bearer}"
            if self._key is not None:
                query = [
                    pair
                    for pair in parse_qsl(parts.query, keep_blank_values=True)
                    if pair[0] != "key"
                ]
                query.append(("key", self._key))
                address = urlunsplit(parts._replace(query=urlencode(query)))
        if self._unanswered >= _PATIENCE:
            raise MalformedError("is not asked for: the server has stopped to answer")
        why = "cannot be fetched"
        for attempt in range(_TRIES):
            if attempt:
                time.sleep(_PAUSE_S * 4 ** (attempt - 1))
            try:
                request = urllib.request.Request(address, headers=headers)
                with self._opener.open(request, timeout=_TIMEOUT_S) as response:
                    self._unanswered = 0
                    return _body(response)
            except urllib.error.HTTPError as error:
                self._unanswered = 0
                error.close()
                why = _answer(error.code)
                if error.code not in (408, 425, 429) and error.code < 500:
                    break
            except (http.client.InvalidURL, UnicodeError, ValueError) as error:
                if isinstance(error, MalformedError):
                    raise
                why = "is not an address"
                break
            except (urllib.error.URLError, http.client.HTTPException, OSError) as error:
                reason = getattr(error, "reason", error)
                why = f"cannot be fetched ({type(reason).__name__})"
                self._unanswered += 1
        # The address may hold the key: no error of urllib's is passed on.
        raise MalformedError(why)


def _body(response: http.client.HTTPResponse) -> bytes:
    """Return the body of an answer, within limits of size and time."""
    start, parts, size = time.monotonic(), [], 0
    while part := response.read(_CHUNK):
        parts.append(part)
        size += len(part)
        if size > LARGEST_TILE:
            raise MalformedError(f"is larger than {LARGEST_TILE >> 20} MiB")
        if time.monotonic() - start > _DEADLINE_S:
            raise MalformedError(f"takes longer than {_DEADLINE_S:.0f} s")
    return b"".join(parts)


def _answer(code: int) -> str:
    """Return what a status of HTTP means here."""
    if code in (401, 403):
        return f"is refused by the server ({code}): is the key right?"
    if code in (404, 410):
        return f"not found ({code})"
    return f"cannot be fetched (the server answers {code})"


class _Redirect(urllib.request.HTTPRedirectHandler):
    """Follows redirects over HTTP; the key stays with the host that it is for."""

    def __init__(self, host: str | None) -> None:
        self._host = host

    def redirect_request(
        self,
        req: urllib.request.Request,
        fp: object,
        code: int,
        msg: str,
        headers: object,
        newurl: str,
    ) -> urllib.request.Request | None:
        """Return the request to the new address."""
        parts = urlsplit(newurl)
        if parts.scheme not in ("http", "https") or (
            parts.scheme == "http" and req.type == "https"
        ):
            raise MalformedError("is refused: it redirects to an address that is not safe")
        further = super().redirect_request(req, fp, code, msg, headers, newurl)  # type: ignore[arg-type]
        if further is not None and parts.hostname != self._host:
            further.remove_header("Authorization")
        return further
