"""Files on storage with a URL: ``s3://bucket/name``, and everything else that fsspec supports."""

from __future__ import annotations

import errno
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from urbantwin.errors import InputError, StageError, UrbanTwinError

__all__ = ["Storage", "is_url"]

_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+://.+")
#: Characters that libraries treat as wildcards.
_PATTERN = re.compile(r"[*?\[]")
_PASSWORD = re.compile(r"(?<=://)([^/@:]*):[^/@]*@")
#: Object stores: files appear atomically, and folders are only names. Elsewhere files are written
#: under another name and renamed.
_OBJECTS = {"s3", "s3a", "gs", "gcs", "az", "abfs", "abfss", "adl", "oss", "memory"}
_FULL = {errno.ENOSPC: "there is no room left", errno.EDQUOT: "the quota is used up"}
_GO_ON = "give the same command again: it goes on from what was made"
_LIBRARIES = {"s3": "s3fs", "s3a": "s3fs", "gs": "gcsfs", "gcs": "gcsfs", "az": "adlfs"}
_LIBRARIES |= {"abfs": "adlfs", "abfss": "adlfs", "adl": "adlfs"}


def is_url(place: object) -> bool:
    """Return whether a value is a URL of storage, not the path of a folder."""
    return isinstance(place, str) and _URL.match(place) is not None


@dataclass(frozen=True)
class Storage:
    """A place on storage, like a folder on a disk; it can be pickled.

    Attributes:
        url: URL without a trailing slash.
    """

    url: str

    @classmethod
    def of(cls, url: str) -> Storage:
        """Return the place of a URL.

        Raises:
            InputError: the URL is invalid or cannot be accessed.
        """
        found = cls(url.rstrip("/"))
        if not is_url(found.url) or _PATTERN.search(url):
            expected = "an address like s3://bucket/name, without *, ? and ["
            raise InputError("names no place", file=str(found), expected=expected)
        with found._told():
            found._reached()
        return found

    def __str__(self) -> str:
        """Return the address, without a password."""
        return _PASSWORD.sub(r"\1:***@", self.url)

    def __truediv__(self, name: str) -> Storage:
        """Return a place below; for an empty name this place."""
        return Storage(f"{self.url}/{name}") if name else self

    def write(self, name: str, *parts: bytes | memoryview) -> None:
        """Write a file atomically.

        Raises:
            InputError: the storage denies it.
            StageError: no space, or the storage fails.
        """
        with self._told(name):
            system, root = self._reached()
            path = f"{root}/{name}"
            content = b"".join(parts)
            if self._protocol in _OBJECTS:
                try:
                    system.pipe_file(path, content)
                except FileNotFoundError:  # only the bucket can be missing
                    raise InputError(
                        "is not there", file=f"{self._protocol}://{root.partition('/')[0]}",
                        expected="a bucket that is there",
                    ) from None  # fmt: skip
                return
            system.makedirs(path.rpartition("/")[0], exist_ok=True)
            system.pipe_file(f"{path}.part", content)
            try:
                system.mv(f"{path}.part", path)
            except FileNotFoundError:  # another run has moved the same bytes
                if not system.exists(path):
                    raise

    def read(self, name: str) -> bytes:
        """Return the content of a file.

        Raises:
            InputError: the file is missing, or the storage denies it.
            StageError: the storage fails.
        """
        with self._told(name):
            system, root = self._reached()
            content: bytes = system.cat_file(f"{root}/{name}")
            return content

    def read_all(self, names: Sequence[str]) -> dict[str, bytes]:
        """Return the content of files, by name; unreadable ones are omitted."""
        with self._told():
            system, root = self._reached()
            paths = {f"{root}/{name}": name for name in names}
            found = system.cat(list(paths), on_error="omit") if paths else {}
            return {paths[path]: content for path, content in found.items() if path in paths}

    def names(self) -> list[str]:
        """Return the names of all files below, sorted; empty if there are none.

        Raises:
            InputError: the storage denies it, or the bucket is missing.
            StageError: the storage fails.
        """
        with self._told():
            system, root = self._reached()
            system.invalidate_cache()
            try:
                found = system.find(root)
            except FileNotFoundError:
                return []
            return sorted(one.removeprefix(root).lstrip("/") for one in found if one != root)

    def remove(self) -> None:
        """Remove all files below.

        Raises:
            InputError: the storage denies it.
            StageError: the storage fails.
        """
        with self._told():
            system, root = self._reached()
            if system.exists(root):
                system.rm(root, recursive=True)

    @property
    def _protocol(self) -> str:
        return self.url.partition("://")[0].lower()

    def _reached(self) -> tuple[Any, str]:
        """Return the file system of the storage, and this place's path in it."""
        from fsspec.core import url_to_fs  # type: ignore[import-untyped, unused-ignore]

        system, root = url_to_fs(self.url)
        return system, root.rstrip("/")

    @contextmanager
    def _told(self, name: str = "") -> Iterator[None]:
        """Convert exceptions of storage libraries into one-line errors."""
        place = f"{self}/{name}" if name else str(self)
        expected = "a place on storage that may be written"
        try:
            yield
        except UrbanTwinError:
            raise
        except ImportError:
            library = _LIBRARIES.get(self._protocol, f"what fsspec needs for {self._protocol}")
            raise InputError(
                "cannot be reached: a library is not installed",
                file=place,
                expected=f"pip install {library}",
            ) from None
        except FileNotFoundError:
            raise InputError("is not there", file=place, expected=expected) from None
        except PermissionError as error:
            raise InputError(
                f"is refused ({_first_line(error)})", file=place, expected=expected
            ) from None
        except OSError as error:
            if error.errno in _FULL:
                raise StageError(f"{place}: {_FULL[error.errno]}; {_GO_ON}") from error
            if error.errno == errno.EROFS:
                raise InputError("is read-only", file=place, expected=expected) from None
            raise StageError(f"{place}: {_first_line(error)}; {_GO_ON}") from error
        except ValueError as error:  # an unknown protocol, an invalid bucket
            raise InputError(_first_line(error), file=place, expected=expected) from None
        except Exception as error:  # types differ between libraries
            if "Validation" in type(error).__name__:  # an invalid bucket name
                raise InputError(_first_line(error), file=place, expected=expected) from None
            if "redential" in type(error).__name__ or "redential" in str(error):
                raise InputError(
                    f"is refused ({_first_line(error)})", file=place, expected="credentials for it"
                ) from None
            raise StageError(f"{place}: {_first_line(error)}; {_GO_ON}") from error


def _first_line(error: BaseException) -> str:
    lines = str(error).strip().splitlines() or [type(error).__name__]
    return " ".join(lines[:2]) if lines[0].endswith(":") else lines[0]
