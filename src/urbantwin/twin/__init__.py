"""The twin folder: building it from a site, and opening it."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.twin.build import build_twin
    from urbantwin.twin.manifest import Corrected
    from urbantwin.twin.twin import Twin, load_twin

__all__ = ["Corrected", "Twin", "build_twin", "load_twin"]

names_on_demand(__name__)
