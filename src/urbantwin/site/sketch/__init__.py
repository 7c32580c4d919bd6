"""Hand-drawn sketches of streets and objects, for a place without a map."""

from urbantwin.site.sketch.kinds import KINDS
from urbantwin.site.sketch.read import read_sketch
from urbantwin.site.sketch.turns import FOLLOWED

__all__ = ["FOLLOWED", "KINDS", "read_sketch"]
