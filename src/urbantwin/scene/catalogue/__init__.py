"""The catalogue of street objects: what tags of the map make them, and what they are built of."""

from urbantwin.scene.catalogue.street_object import Catalogue, StreetObject, street_objects

__all__ = ["Catalogue", "StreetObject", "street_objects"]
