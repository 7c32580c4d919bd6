"""Samples made different: turned, flipped, scaled, fewer beams, objects of other frames."""
