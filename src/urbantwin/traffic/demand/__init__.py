"""Demand: who sets out, when, by which way and with what manners, from what a site asks for."""

__all__: list[str] = []
