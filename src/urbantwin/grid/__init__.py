"""Grids of runs: axes and their levels, the cells of a design, and which cells are done."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.grid.axes import MOST_CELLS, Axis, Cell, Level, factorial, one_at_a_time
    from urbantwin.grid.journal import Journal

__all__ = ["MOST_CELLS", "Axis", "Cell", "Journal", "Level", "factorial", "one_at_a_time"]

names_on_demand(__name__)
