"""The catalogue of street objects: the map tags that create them, and their parts."""

from urbantwin.scene.catalogue.street_object import Catalogue, StreetObject, street_objects

__all__ = ["Catalogue", "StreetObject", "street_objects"]
