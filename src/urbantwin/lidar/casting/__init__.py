"""Ray tracers behind one interface."""

__all__: list[str] = []
