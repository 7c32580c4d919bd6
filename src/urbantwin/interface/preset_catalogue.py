"""Presets for `init`: places where roadside datasets were recorded."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from urbantwin.interface.command import command
from urbantwin.interface.stage import ShowProgress
from urbantwin.interface.summary import Listing, Summary

if TYPE_CHECKING:
    from urbantwin.site.presets import Preset

__all__ = ["PresetCatalogue", "presets"]


class PresetCatalogue(Listing, Mapping[str, "Preset"]):
    """Presets by name; printed as a table."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the presets."""
        from urbantwin.site.presets import preset_names

        return preset_names()

    def __getitem__(self, name: str) -> Preset:
        """Return a preset by its name.

        Raises:
            KeyError: no preset has this name.
        """
        from urbantwin.site.presets import preset

        if name not in self.names:
            raise KeyError(name)
        return preset(name)

    def __iter__(self) -> Iterator[str]:
        """Return the names."""
        return iter(self.names)

    def __len__(self) -> int:
        """Return the number of presets."""
        return len(self.names)

    def __repr__(self) -> str:
        """Return the table."""
        rows = [("preset", "place", "sensors", "published"), *map(_row, self.values())]
        widths = [max(len(row[k]) for row in rows) + 2 for k in range(3)]
        return "\n".join("".join(map(str.ljust, row[:3], widths)) + row[3] for row in rows)

    def summary(self) -> Summary:
        """Return the known and unknown values of each preset, JSON-compatible."""
        return Summary(presets=[_entry(one) for one in self.values()])


@command
def presets(
    *,
    progress: ShowProgress = True,
) -> PresetCatalogue:
    """List places where roadside datasets were recorded.

    `init` takes their names as ``preset``.

    Args:
        progress: show progress; or a function that is called with (share, doing).

    Example:
        >>> ut.site.presets()
        >>> ut.site.presets()["tumtraf-s110"].unknown
        $ urbantwin site presets
    """
    return PresetCatalogue()


def _row(one: Preset) -> tuple[str, str, str, str]:
    """Return a preset's row: name, title, sensor models, and which positions are published."""
    counts = Counter(sensor.model for sensor in one.rig.sensors)
    models = ", ".join(f"{count} {model}" for model, count in counts.items())
    published = "the sensors alone"
    if one.place is not None:
        placed = sum(sensor.is_placed for sensor in one.rig.sensors)
        published = f"place (within {one.place.within_m:g} m)"
        published += f", where {placed} of its sensors stand" if placed else ""
    return one.name, one.title, models, published


def _entry(one: Preset) -> dict[str, Any]:
    place = one.place
    return {
        "name": one.name,
        "title": one.title,
        "country": one.country,
        "recording": one.recording,
        "licence": one.licence,
        "homepage": one.homepage,
        "anchor": place
        and {
            "latitude": place.latitude,
            "longitude": place.longitude,
            "within_m": place.within_m,
        },
        "radius_m": one.radius_m,
        "rate_hz": one.rig.rate_hz,
        "sensors": [
            {"name": sensor.name, "model": sensor.model, "place_published": sensor.is_placed}
            for sensor in one.rig.sensors
        ],
        "unknown": one.unknown,
    }
