"""Road markings in plan, from the lane model and the lane network."""

from urbantwin.roads.marking.give_way import GIVE_WAY
from urbantwin.roads.marking.line_through import guide_lines, lines_through
from urbantwin.roads.marking.lines import Line, lane_marks, stop_lines, strokes
from urbantwin.roads.marking.paint import PAINT_KINDS, Paint, painted, zebra
from urbantwin.roads.marking.turn_arrow import ARROW_M, arrow, arrow_at, turn_arrow, turns

__all__ = [
    "ARROW_M",
    "GIVE_WAY",
    "PAINT_KINDS",
    "Line",
    "Paint",
    "arrow",
    "arrow_at",
    "guide_lines",
    "lane_marks",
    "lines_through",
    "painted",
    "stop_lines",
    "strokes",
    "turn_arrow",
    "turns",
    "zebra",
]
