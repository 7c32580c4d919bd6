"""Places at which roadside datasets were recorded: what is published of each, and what is not."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.site.presets.preset import Preset, preset, preset_names
    from urbantwin.site.presets.preset_site import init_preset_site

__all__ = [
    "Preset",
    "init_preset_site",
    "preset",
    "preset_names",
]

names_on_demand(__name__)
