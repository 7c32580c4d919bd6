"""Traffic signals and signs: which junctions have them, their programs and where they stand."""
