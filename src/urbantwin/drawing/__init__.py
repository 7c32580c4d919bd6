"""Pictures, written without a display: plans, labelled frames, range images, histograms, scenes.

Modules are imported by their own names (``urbantwin.drawing.plan``), so that a picture that is not
drawn loads nothing.
"""

__all__: list[str] = []
