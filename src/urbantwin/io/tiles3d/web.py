"""Tiles fetched over HTTP, with a key that is sent to their server only."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from urllib.parse import parse_qsl, quote, urlencode, urljoin, urlsplit, urlunsplit

from urbantwin.download import (
    Client,
    DownloadError,
    Limits,
    Origin,
    keep_bytes,
    kept_bytes,
    key_for,
    parse_address,
    parse_origin,
)
from urbantwin.errors import InputError
from urbantwin.io.tiles3d.store import LARGEST_TILE
from urbantwin.io.values import MalformedError
from urbantwin.site.geometry import GeometrySource

__all__ = ["open_web"]

#: Limits: size of a tile, total size of a source, and total time.
LIMITS = Limits(LARGEST_TILE, 8 << 30, 4 * 3600.0)
#: Query parameters that identify the user.
_PERSONAL = frozenset({"key", "session", "access_token", "token", "sig", "signature"})


def open_web(source: GeometrySource, environment: Mapping[str, str] | None = None) -> Web:
    """Return the store of a source given by its URL.

    The key is the value of the environment variable ``key_env``. It is sent as ``key=`` in the URL
    (Google's Photorealistic 3D Tiles), or as ``Authorization: Bearer`` if the variable's name
    contains TOKEN (Cesium ion) or its value starts with "Bearer".

    Raises:
        InputError: the user did not allow the variable to be sent there (`download.key_for`), it is
            not set, or the URL is not HTTP.
    """
    environment = os.environ if environment is None else environment
    spec = source.spec
    key, bearer = None, None
    if spec.key_env is not None:
        try:
            value = key_for(
                spec.key_env,
                spec.url or "",
                environment,
                file=source.document.file,
                place=source.place("key_env"),
            )
        except DownloadError as error:
            raise _no_address(source, error) from None
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
    if bearer is not None and not (bearer.isascii() and bearer.isprintable()):
        raise InputError(
            f"the environment variable {spec.key_env} holds characters that an HTTP header must "
            "not have",
            file=source.document.file,
            place=source.place("key_env"),
            expected="a token of printable ASCII",
        )
    cache = environment.get(CACHE)
    try:
        return Web(
            spec.url or "",
            key=key,
            bearer=bearer,
            origins=[parse_origin(text) for text in spec.origins],
            cache=Path(cache) if cache else None,
        )
    except DownloadError as error:
        raise _no_address(source, error) from None


def _no_address(source: GeometrySource, error: DownloadError) -> InputError:
    return InputError(
        str(error),
        file=source.document.file,
        place=source.place("url"),
        expected="https://...",
    )


class Web:
    """HTTP and HTTPS URLs, fetched by `download.Client`.

    The query of a parent's URL (``session=``) is passed on to its children of the same origin, as
    Google's tiles require.

    Args:
        url: URL of the root.
        key: sent as ``key=``, or ``None``.
        bearer: sent as ``Authorization: Bearer``, or ``None``.
        origins: other allowed origins.
        cache: a folder to cache responses, or ``None``.

    Raises:
        DownloadError: the root is not an HTTP URL.
    """

    parallel = 8

    def __init__(
        self,
        url: str,
        *,
        key: str | None = None,
        bearer: str | None = None,
        origins: Iterable[Origin] = (),
        cache: Path | None = None,
    ) -> None:
        home = parse_address(url)
        # Credentials in the URL are as secret as those of an environment variable.
        personal = [v for name, v in parse_qsl(home.query) if name.lower() in _PERSONAL]
        self.root = str(home)
        self._folder = home.path.rpartition("/")[0] + "/"
        self._cache = cache
        self._client = Client(
            self.root, LIMITS, origins=origins, key=key, bearer=bearer, secrets=personal
        )

    def resolve(self, base: str, uri: str) -> str:
        """Return the address of ``uri`` relative to the file at ``base``."""
        try:
            joined = urljoin(base, quote(uri.strip(), safe="%/:=&?~#+!$,;'@()*[]"))
            there, above = parse_address(joined), parse_address(base)
            self._client.check(there)
        except DownloadError as error:
            raise MalformedError(str(error)) from None
        except ValueError:
            raise MalformedError("is not an address") from None
        query = parse_qsl(there.query, keep_blank_values=True)
        if there.origin == above.origin:
            own = {name for name, _ in query}
            inherited = parse_qsl(above.query, keep_blank_values=True)
            query += [(name, value) for name, value in inherited if name not in own]
        return f"{there.origin}{there.path}" + (f"?{urlencode(query)}" if query else "")

    def fetch(self, address: str) -> bytes:
        """Return the bytes at an address; transient failures are retried."""
        kept = self._kept(address)
        if kept is not None and (known := kept_bytes(kept, USABLE)) is not None:
            return known
        try:
            data = self._client.get(address)
        except DownloadError as error:
            if error.spent:
                raise InputError(
                    str(error),
                    file=self.name(self.root),
                    expected="a larger geometric_error_m, or a smaller region",
                ) from None
            raise MalformedError(str(error)) from None
        if kept is not None and not self._client.secrets.held_by(data):
            keep_bytes(kept, data, USABLE)
        return data

    def name(self, address: str) -> str:
        """Return the address without its query, relative to the root's folder."""
        there = parse_address(address)
        root, origin, path = self._client.root, there.origin, there.path
        if origin != root:
            name = f"{origin if origin.host == root.host else origin.netloc}{path}"
        elif path.startswith(self._folder):
            name = path[len(self._folder) :] or path
        else:
            name = f"{origin.host}{path}"
        return self._client.secrets.hidden(name)

    def hidden(self, text: str) -> str:
        """Return a text without the key, which a server may have written into a file."""
        return self._client.secrets.hidden(text)

    def _kept(self, address: str) -> Path | None:
        """Return the cached file of an address; its name does not identify the user."""
        if self._cache is None:
            return None
        parts = urlsplit(address)
        query = [(k, v) for k, v in parse_qsl(parts.query) if k.lower() not in _PERSONAL]
        plain = urlunsplit((parts.scheme, parts.netloc, parts.path, urlencode(query), ""))
        digest = hashlib.sha256(plain.encode()).hexdigest()
        return self._cache / digest[:2] / digest


#: Environment variable with the cache folder.
CACHE = "URBANTWIN_TILE_CACHE"
#: Expected value of the variable, for errors.
USABLE = f"a folder of your own with room, or no {CACHE}"
