"""Studies with one motion under many rigs: what differs, and how sure that is."""

__all__: list[str] = []
