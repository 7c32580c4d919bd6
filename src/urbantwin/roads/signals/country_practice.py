"""Practice of countries for signals and signs: near side, far side or mast arm; which signs.

Sources for the positions of heads:

- United States and countries that follow it: MUTCD 2009, 4D.11 to 4D.15: the faces 40 to 180 ft
  beyond the stop line, one for each lane or two for the main movement; over the lanes 15 ft and
  more clear, beside them 8 ft.
- Japan, Korea, Taiwan, China: far side, over the lanes; horizontal heads in the first three
  (Japan: Road Traffic Act Enforcement Order, form 1; Taiwan: 道路交通標誌標線號誌設置規則, 212 ff.;
  China: GB 14886-2016, 5).
- Germany, Austria, Switzerland: RiLSA 2015, 6.3: at the stop line, repeated above the lanes where
  there are two or more of them; 4.5 m clear above lanes, 2.1 m beside.
- elsewhere in Europe: Vienna Convention on Road Signs and Signals 1968, 23 and European Annex: on
  the near side, repeated above the carriageway or beyond.
- United Kingdom and Ireland: Traffic Signs Manual, Chapter 6, 4.2: a primary at the stop line and
  a secondary beyond the junction.
- Australia and New Zealand: Austroads Guide to Traffic Management Part 10; AS 1742.14: a primary at
  the stop line and a secondary at the far side, mast arms over three lanes and more.

Sign numbers are those of each country's own catalogue.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

from urbantwin.roads.model import RoadSignal

__all__ = [
    "Practice",
    "SpeedSign",
    "meaning_of",
    "mph",
    "plate_of",
    "practice_of",
    "speed_sign",
    "stop_sign",
    "yield_sign",
]


Sign = TypeVar("Sign")


@dataclass(frozen=True)
class Practice:
    """Positions of the signal heads of an approach.

    Attributes:
        near: at the stop line, on the kerb's side.
        far: beyond the junction, on the kerb's side.
        arm_lanes: minimum number of lanes of approaches with heads above their lanes too, on an arm
            at the far side if there is one, else at the near side.
        horizontal: whether heads above lanes are horizontal.
    """

    near: bool
    far: bool
    arm_lanes: int
    horizontal: bool = False


@dataclass(frozen=True)
class SpeedSign:
    """A country's speed limit sign and the shape of its plate, round or upright."""

    type: str
    subtype: str = "-1"
    shape: str = "disc"


_FAR = Practice(near=False, far=True, arm_lanes=2)
_FAR_HORIZONTAL = Practice(near=False, far=True, arm_lanes=2, horizontal=True)
_BOTH = Practice(near=True, far=True, arm_lanes=9)
_BOTH_WIDE = Practice(near=True, far=True, arm_lanes=3)
_NEAR_WIDE = Practice(near=True, far=False, arm_lanes=2)
_NEAR = Practice(near=True, far=False, arm_lanes=3)

_PRACTICES = (
    (_FAR, "US CA PR GU VI AS MP MX PH BR CL CO PE"),
    (_FAR_HORIZONTAL, "JP KR TW"),
    (_FAR, "CN"),
    (_BOTH, "GB IE GG JE IM GI MT CY HK SG"),
    (_BOTH_WIDE, "AU NZ ZA IN MY"),
    (_NEAR_WIDE, "DE AT CH LI LU"),
)
_PRACTICE = {country: practice for practice, names in _PRACTICES for country in names.split()}

#: Countries that post speed limits in miles per hour.
_MPH = frozenset("US PR GU VI AS MP GB GG JE IM".split())

_SPEED = {
    "AT": SpeedSign("52", "10a"), "AU": SpeedSign("R4-1", shape="upright"),
    "BE": SpeedSign("C43"), "CA": SpeedSign("RB-1", shape="upright"), "CH": SpeedSign("2", "30"),
    "CN": SpeedSign("38"), "CZ": SpeedSign("B20a"), "DE": SpeedSign("274"),
    "DK": SpeedSign("C55"), "ES": SpeedSign("R-301"), "FI": SpeedSign("C32"),
    "FR": SpeedSign("B14"), "GB": SpeedSign("670"), "HU": SpeedSign("30"),
    "IE": SpeedSign("RUS", "044"), "IT": SpeedSign("II", "50"), "JP": SpeedSign("323"),
    "KR": SpeedSign("224"), "LU": SpeedSign("C", "14"), "NL": SpeedSign("A1"),
    "NO": SpeedSign("362"), "NZ": SpeedSign("R1-1"), "PL": SpeedSign("B-33"),
    "PT": SpeedSign("C13"), "SE": SpeedSign("C31"), "SG": SpeedSign("323"),
    "TW": SpeedSign("限5"), "US": SpeedSign("R2-1", shape="upright"),
    "ZA": SpeedSign("R201"),
}  # fmt: skip
#: Stop and give-way signs.
_STOP = {
    "AU": "R1-1", "BE": "B5", "CA": "RA-1", "DE": "206", "DK": "B13", "FI": "B6", "FR": "AB4",
    "GB": "601.1", "IE": "RUS 027", "JP": "330", "NL": "B7", "NO": "204", "NZ": "R2-1",
    "PL": "B-20", "SE": "B2", "TW": "遵1", "US": "R1-1", "ZA": "R1",
}  # fmt: skip
_YIELD = {
    "AU": "R1-2", "BE": "B1", "CA": "RA-2", "DE": "205", "DK": "B11", "FI": "B5", "FR": "AB3a",
    "GB": "602", "IE": "RUS 026", "JP": "329-2", "NL": "B6", "NO": "202", "NZ": "R2-2",
    "PL": "A-7", "SE": "B1", "TW": "遵2", "US": "R1-2", "ZA": "R2",
}  # fmt: skip


def practice_of(country: str) -> Practice:
    """Return a country's practice (ISO 3166-1 alpha-2); by default the Vienna Convention's."""
    return _PRACTICE.get(country, _NEAR)


def mph(country: str) -> bool:
    """Return whether a country posts speed limits in miles per hour."""
    return country in _MPH


def speed_sign(country: str) -> tuple[str, SpeedSign]:
    """Return catalogue and sign of a speed limit; by default the German number."""
    return _numbered(country, _SPEED, SpeedSign("274"))


def stop_sign(country: str) -> tuple[str, str]:
    """Return catalogue and number of the stop sign."""
    return _numbered(country, _STOP, "206")


def yield_sign(country: str) -> tuple[str, str]:
    """Return catalogue and number of the sign to give way."""
    return _numbered(country, _YIELD, "205")


def meaning_of(signal: RoadSignal) -> str | None:
    """Return the meaning of a sign: limit, stop or yield; ``None`` for others."""
    country = signal.country.upper()
    if signal.type == _STOP.get(country, "206"):
        return "stop"
    if signal.type == _YIELD.get(country, "205"):
        return "yield"
    sign = _SPEED.get(country, SpeedSign("274"))
    alike = sign.type == signal.type and sign.subtype in ("-1", signal.subtype)
    return "limit" if alike else None


def plate_of(signal: RoadSignal) -> str:
    """Return the shape of a sign's plate: disc, upright, octagon or triangle."""
    meaning = meaning_of(signal)
    if meaning == "limit":
        return _SPEED.get(signal.country.upper(), SpeedSign("274")).shape
    return {"stop": "octagon", "yield": "triangle"}.get(meaning or "", "disc")


def _numbered(country: str, table: dict[str, Sign], default: Sign) -> tuple[str, Sign]:
    country = {"PR": "US", "GU": "US", "GG": "GB", "JE": "GB", "IM": "GB"}.get(country, country)
    return (country, table[country]) if country in table else ("OpenDRIVE", default)
