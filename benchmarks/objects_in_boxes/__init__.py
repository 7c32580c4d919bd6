"""Bodies of the catalogue in the boxes of labelled real frames, seen along the frames' own rays."""
