"""Origins: servers that ``site.yaml`` permits for HTTP requests."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator

from urbantwin.download import DownloadError, parse_address, parse_origin
from urbantwin.site.yaml_document import wrong

__all__ = ["OriginText", "check_origins"]


def _one_origin(text: str) -> str:
    try:
        parse_origin(text)
    except DownloadError:
        shown = "an address" if "@" in text else repr(text[:60])
        raise wrong(
            f"is {shown}, which is not an origin",
            "scheme, host and port: https://tiles.example.org",
        ) from None
    return text


#: ``https://host`` or ``http://host:8080``: a further permitted server.
OriginText = Annotated[str, AfterValidator(_one_origin)]


def check_origins(url: str | None, origins: list[str], name: str) -> None:
    """Check that origins fit their address.

    Args:
        url: the address, or ``None`` for a source that is a file.
        origins: as `OriginText`.
        name: field of the address.

    Raises:
        PydanticCustomError: origins without an address, or less secure than it.
    """
    if url is None:
        if origins:
            raise wrong(f"has origins without {name}", "them for an address only")
        return
    if url.lower().startswith("https:"):
        for text in origins:
            if parse_address(text).origin.scheme != "https":
                raise wrong(f"has the origin {text!r} of http", "https, as its own address has")
