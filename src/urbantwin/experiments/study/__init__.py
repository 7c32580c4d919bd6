"""Studies of robustness: faults of sensors, weather and traffic, level by level, over seeds."""

__all__: list[str] = []
