"""Sites of ``site.yaml``: region, rig, OpenStreetMap extract and elevation model."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.interface.input_check import Findings, check
    from urbantwin.interface.preset_catalogue import PresetCatalogue, presets
    from urbantwin.site.conditions import Clutter
    from urbantwin.site.dem import DemGrid, check_dem, grid_step_m, read_heights
    from urbantwin.site.extract import Extract, OsmFeature, Relation, Way, WayPiece
    from urbantwin.site.extract_file import box_around, read_extract
    from urbantwin.site.geometry import GeometrySource, GeometrySpec
    from urbantwin.site.imagery import ImagerySource, ImagerySpec
    from urbantwin.site.initial_site import init_site
    from urbantwin.site.junction_proposal import JunctionProposal, propose_junction
    from urbantwin.site.orthophoto import Orthophoto, read_orthophoto
    from urbantwin.site.rig import Effects, RigSpec, SensorSpec, load_rig_spec
    from urbantwin.site.site import InputFile, Site, check_extract, load_site
    from urbantwin.site.traffic import TrafficSpec, load_traffic_changes

__all__ = [
    "Clutter",
    "DemGrid",
    "Effects",
    "Extract",
    "Findings",
    "GeometrySource",
    "GeometrySpec",
    "ImagerySource",
    "ImagerySpec",
    "InputFile",
    "JunctionProposal",
    "Orthophoto",
    "OsmFeature",
    "PresetCatalogue",
    "Relation",
    "RigSpec",
    "SensorSpec",
    "Site",
    "TrafficSpec",
    "Way",
    "WayPiece",
    "box_around",
    "check",
    "check_dem",
    "check_extract",
    "grid_step_m",
    "init_site",
    "load_rig_spec",
    "load_site",
    "load_traffic_changes",
    "presets",
    "propose_junction",
    "read_extract",
    "read_heights",
    "read_orthophoto",
]

names_on_demand(__name__)
