"""Campaigns: recordings of all combinations of sites, seeds, rigs, weather and scenarios."""

__all__: list[str] = []
