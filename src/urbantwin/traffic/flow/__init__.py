"""Flow: the carried share of the requested traffic, and bottlenecks."""

__all__: list[str] = []
