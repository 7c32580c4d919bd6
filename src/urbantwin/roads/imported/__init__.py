"""Maps that somebody made, OpenDRIVE or Lanelet2, as the roads of a site."""

from urbantwin.roads.imported.build import PreparedMap, build_imported_roads, prepared_map
from urbantwin.roads.imported.read import ImportedMap, read_map

__all__ = ["ImportedMap", "PreparedMap", "build_imported_roads", "prepared_map", "read_map"]
