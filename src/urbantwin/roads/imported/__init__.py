"""Imported road maps (OpenDRIVE, Lanelet2, Argoverse 2) as the roads of a site."""

from urbantwin.roads.imported.build import PreparedMap, build_imported_roads, prepared_map
from urbantwin.roads.imported.initial_site import init_site_of_map
from urbantwin.roads.imported.read import ImportedMap, describe_map, is_map_of_roads, read_map

__all__ = [
    "ImportedMap",
    "PreparedMap",
    "build_imported_roads",
    "describe_map",
    "init_site_of_map",
    "is_map_of_roads",
    "prepared_map",
    "read_map",
]
