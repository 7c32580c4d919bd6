"""Presets: places of roadside datasets, with their published facts and gaps."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.site.presets.preset import Preset, preset, preset_names
    from urbantwin.site.presets.preset_site import (
        check_place,
        init_preset_site,
        where_extracts_are,
    )

__all__ = [
    "Preset",
    "check_place",
    "init_preset_site",
    "preset",
    "preset_names",
    "where_extracts_are",
]

names_on_demand(__name__)
