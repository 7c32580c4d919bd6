"""The control of a comparison: an arbitrary site, made by the same pipeline as the twin."""

from urbantwin.fidelity.arbitrary.recording import arbitrary_recording

__all__ = ["arbitrary_recording"]
