"""Samples made different: turned, flipped, scaled, with fewer beams, with objects of other frames."""
