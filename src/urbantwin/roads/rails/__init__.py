"""Rails of trams: directed tracks of the map, and their part of SUMO's network."""

from urbantwin.roads.rails.tracks import Track, add_rails, with_trams

__all__ = ["Track", "add_rails", "with_trams"]
