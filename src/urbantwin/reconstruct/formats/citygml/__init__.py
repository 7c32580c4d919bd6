"""CityGML 1.0 to 3.0 (OGC 08-007r1, 12-019, 20-010)."""

from urbantwin.reconstruct.formats.citygml.read import read_citygml

__all__ = ["read_citygml"]
