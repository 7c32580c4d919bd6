"""Campaigns: sites, seeds, rigs, weather and scenarios, all of them recorded with each other."""

__all__: list[str] = []
