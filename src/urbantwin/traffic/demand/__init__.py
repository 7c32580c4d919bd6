"""Demand: the trips of all actors, with departure times, routes and vehicle types, of a site."""

__all__: list[str] = []
