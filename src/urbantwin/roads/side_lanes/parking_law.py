"""How far from junctions the law lets people park."""

from __future__ import annotations

__all__ = ["clear_of_junction"]

#: Metres from a junction or the crossing before it. Germany: StVO section 12 (3), 5 m. United
#: States: Uniform Vehicle Code 11-1003, 20 ft from a crosswalk at an intersection. Australia:
#: Australian Road Rules 170, 10 m. United Kingdom: Highway Code 243, 10 m. Taiwan: Road Traffic
#: Safety Rules 111, 10 m. Japan: Road Traffic Act 44, 5 m. Elsewhere: Vienna Convention on Road
#: Traffic, article 23, 5 m.
CLEAR_M = {"US": 6.1, "CA": 6.1, "AU": 10.0, "NZ": 6.0, "GB": 10.0, "IE": 5.0, "TW": 10.0}


def clear_of_junction(country: str) -> float:
    """Return the distance in a country (ISO 3166-1 alpha-2; empty if unknown), metres."""
    return CLEAR_M.get(country, 5.0)
