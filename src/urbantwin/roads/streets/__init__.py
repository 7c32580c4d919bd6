"""From netconvert's network to roads of the lane model."""
