"""The side of driving of a country."""

from __future__ import annotations

from urbantwin.site.country import country_of

__all__ = ["country_of", "driving_side"]

#: Countries and territories with left-hand traffic (ISO 3166-1 alpha-2). Source: Wikipedia, "Left-
#: and right-hand traffic", table of countries.
LEFT = frozenset(
    "AG AI AU BB BD BM BN BS BT BW CC CK CX CY DM FJ FK GB GD GG GY HK ID IE IM IN JE JM JP KE KI "
    "KN KY LC LK LS MO MS MT MU MV MW MY MZ NA NF NR NU NZ PG PK PN SB SC SG SH SR SZ TC TH TK TL "
    "TO TT TV TZ UG VC VG VI WS ZA ZM ZW".split()
)


def driving_side(latitude: float, longitude: float) -> str:
    """Return ``left`` or ``right`` for a place in degrees; ``right`` if its country is unknown."""
    return "left" if country_of(latitude, longitude) in LEFT else "right"
