"""Detectors that learn from labelled frames: pillars, a network, its training, what it detects."""
