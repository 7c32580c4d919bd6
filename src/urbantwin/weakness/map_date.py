"""How old a map is."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import osmium
import osmium.osm

__all__ = ["map_date"]

#: Keys of a file's header that tell of when its data are.
_KEYS = ("osmosis_replication_timestamp", "timestamp")
#: Larger files are not read once more for the times of their elements, bytes.
_MOST = 30_000_000


def map_date(path: Path) -> datetime | None:
    """Return of when an extract is: what its header says, or else its newest element's time.

    Args:
        path: an extract that was read before.

    Returns:
        ``None`` where it does not tell, or is large and its header does not.
    """
    with osmium.io.Reader(str(path)) as reader:
        header = reader.header()
        for key in _KEYS:
            told = header.get(key)
            if told:
                try:
                    found = datetime.fromisoformat(told)
                except ValueError:
                    continue
                return found if found.tzinfo else found.replace(tzinfo=UTC)
    if path.stat().st_size > _MOST:
        return None
    newest = None
    for item in osmium.FileProcessor(str(path)):
        if isinstance(item, osmium.osm.OSMObject):
            time = item.timestamp
            newest = time if newest is None else max(newest, time)
    # Files without times have that of 1970.
    return newest if newest is not None and newest.year > 2003 else None
