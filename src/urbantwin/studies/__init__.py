"""Studies: one motion under many rigs, channels and conditions, judged with intervals."""

__all__: list[str] = []
