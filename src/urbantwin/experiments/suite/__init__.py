"""Regression suites: scenarios with seeds that are driven again, and what became different."""

__all__: list[str] = []
