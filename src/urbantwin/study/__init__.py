"""Studies: one motion under many rigs, so that only the rig differs."""

__all__: list[str] = []
