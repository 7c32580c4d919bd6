"""Georeference of a scene, for formats without a coordinate system."""

from __future__ import annotations

from typing import Any

from urbantwin.twin import Twin

__all__ = ["georeference", "utm_code"]


def georeference(twin: Twin) -> dict[str, Any]:
    """Return the site frame as JSON values: anchor, PROJ string and reference of z."""
    return {
        "latitude": twin.frame.latitude,
        "longitude": twin.frame.longitude,
        "proj": twin.frame.proj,
        "z": "metres above the ground at the anchor",
        "anchor_height_m": twin.anchor_height_m,
        "twin": str(twin.manifest["name"]),
    }


def utm_code(latitude: float, longitude: float) -> int:
    """Return the EPSG code of the UTM zone of WGS 84 at a place."""
    zone = min(int((longitude + 180.0) // 6.0) + 1, 60)
    return (32600 if latitude >= 0 else 32700) + zone
