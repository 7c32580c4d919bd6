"""Flow: what passes of what was asked for, and what holds it up."""

__all__: list[str] = []
