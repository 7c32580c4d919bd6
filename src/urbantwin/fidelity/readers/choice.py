"""A part of a file, named behind a colon: ``bag.mcap:/lidar/points``, ``a.pcap:192.168.1.201``."""

from __future__ import annotations

from pathlib import Path

__all__ = ["file_and_choice"]


def file_and_choice(path: Path) -> tuple[Path, str | None]:
    """Return the file or folder, and what is chosen of it; None where nothing is.

    What is there by its whole name is meant as a whole.
    """
    text = str(path)
    if ":" not in text or path.exists():
        return path, None
    at = text.find(":")
    while at >= 0:
        file = Path(text[:at])
        if text[:at] and text[at + 1 :] and file.exists():
            return file, text[at + 1 :]
        at = text.find(":", at + 1)
    return path, None
