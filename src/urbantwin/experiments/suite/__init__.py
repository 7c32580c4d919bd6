"""Regression suites: scenarios with seeds that are simulated again, and their differences."""

__all__: list[str] = []
