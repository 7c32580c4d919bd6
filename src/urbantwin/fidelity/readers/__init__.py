"""Readers of what real sensors recorded, in the layouts of the datasets that people have."""

from urbantwin.fidelity.readers.layouts import LAYOUTS, Layout, open_recording
from urbantwin.fidelity.readers.recording import Recording

__all__ = ["LAYOUTS", "Layout", "Recording", "open_recording"]
