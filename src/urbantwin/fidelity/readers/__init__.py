"""Readers of real recordings, in the layouts of published datasets and sensors."""

from urbantwin.fidelity.readers.layouts import LAYOUTS, Layout, open_recording
from urbantwin.fidelity.readers.recording import Recording

__all__ = ["LAYOUTS", "Layout", "Recording", "open_recording"]
