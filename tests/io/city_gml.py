"""CityGML as a test writes it, of any version: buildings whose shape everybody agrees on."""

from collections.abc import Iterable, Sequence

import numpy as np

#: A house 10 m along x and 8 m along y, eaves at 6 m, ridge at 9 m along x: 600 m3, and each half
#: of its roof is 10 m by 5 m.
HOUSE_M3, ROOF_M2 = 600.0, 100.0
_A, _B, _C, _D = (0, 0), (10, 0), (10, 8), (0, 8)
HOUSE = {
    "GroundSurface": [[(*p, 0) for p in (_A, _D, _C, _B)]],
    "WallSurface": [
        [(*_A, 0), (*_B, 0), (*_B, 6), (*_A, 6)],
        [(*_C, 0), (*_D, 0), (*_D, 6), (*_C, 6)],
        [(*_B, 0), (*_C, 0), (*_C, 6), (10, 4, 9), (*_B, 6)],
        [(*_D, 0), (*_A, 0), (*_A, 6), (0, 4, 9), (*_D, 6)],
    ],
    "RoofSurface": [
        [(*_A, 6), (*_B, 6), (10, 4, 9), (0, 4, 9)],
        [(*_C, 6), (*_D, 6), (0, 4, 9), (10, 4, 9)],
    ],
}
_GML = {"1.0": "http://www.opengis.net/gml", "2.0": "http://www.opengis.net/gml"}


def ring(points: Sequence[Sequence[float]], how: str = "posList") -> str:
    closed = [*points, points[0]]
    if how == "pos":
        inner = "".join("<gml:pos>{} {} {}</gml:pos>".format(*map(repr, p)) for p in closed)
    elif how == "coordinates":
        text = " ".join(",".join(repr(float(v)) for v in p) for p in closed)
        inner = f"<gml:coordinates>{text}</gml:coordinates>"
    else:
        text = " ".join(repr(float(v)) for p in closed for v in p)
        inner = f'<gml:posList srsDimension="3">{text}</gml:posList>'
    return f"<gml:LinearRing>{inner}</gml:LinearRing>"


def polygon(
    points: Sequence[Sequence[float]],
    name: str = "",
    holes: Iterable[Sequence[Sequence[float]]] = (),
    how: str = "posList",
) -> str:
    identity = f' gml:id="{name}"' if name else ""
    inner = "".join(f"<gml:interior>{ring(hole, how)}</gml:interior>" for hole in holes)
    return (
        f"<gml:Polygon{identity}><gml:exterior>{ring(points, how)}</gml:exterior>{inner}"
        "</gml:Polygon>"
    )


def solid(members: Iterable[str]) -> str:
    inner = "".join(f"<gml:surfaceMember>{one}</gml:surfaceMember>" for one in members)
    return (
        "<gml:Solid><gml:exterior><gml:CompositeSurface>"
        f"{inner}</gml:CompositeSurface></gml:exterior></gml:Solid>"
    )


def references(names: Iterable[str]) -> str:
    inner = "".join(f'<gml:surfaceMember xlink:href="#{name}"/>' for name in names)
    return (
        "<gml:Solid><gml:exterior><gml:CompositeSurface>"
        f"{inner}</gml:CompositeSurface></gml:exterior></gml:Solid>"
    )


def house(version: str, name: str = "h1", at=(0.0, 0.0, 0.0), level: int = 2, how="posList") -> str:
    """A building whose solid refers to its wall, roof and ground surfaces."""
    new = version == "3.0"
    bounded, space = ("core:boundary", "con") if new else ("bldg:boundedBy", "bldg")
    prefix = "core" if new else "bldg"
    parts, names = [], []
    for kind, polygons in HOUSE.items():
        for points in polygons:
            own = f"{name}_{len(names)}"
            names.append(own)
            shape = polygon((np.array(points, float) + at).tolist(), own, how=how)
            surface = f"<gml:MultiSurface><gml:surfaceMember>{shape}</gml:surfaceMember>"
            parts.append(
                f'<{bounded}><{space}:{kind} gml:id="{own}_s"><{prefix}:lod{level}MultiSurface>'
                f"{surface}</gml:MultiSurface></{prefix}:lod{level}MultiSurface>"
                f"</{space}:{kind}></{bounded}>"
            )
    whole = f"<{prefix}:lod{level}Solid>{references(names)}</{prefix}:lod{level}Solid>"
    order = [*parts, whole] if new else [whole, *parts]
    return f'<bldg:Building gml:id="{name}">{"".join(order)}</bldg:Building>'


def block(version: str, name: str, low, high, inside: str = "") -> str:
    """A building of level of detail 1: a box."""
    (a, b, c), (d, e, f) = low, high
    corners = [(a, b), (d, b), (d, e), (a, e)]
    faces = [[(*p, c) for p in corners[::-1]], [(*p, f) for p in corners]]
    for k in range(4):
        p, q = corners[k], corners[(k + 1) % 4]
        faces.append([(*p, c), (*q, c), (*q, f), (*p, f)])
    prefix = "core" if version == "3.0" else "bldg"
    shape = solid(polygon(face) for face in faces)
    return (
        f'<bldg:Building gml:id="{name}"><{prefix}:lod1Solid>{shape}</{prefix}:lod1Solid>{inside}'
        "</bldg:Building>"
    )


def city(version: str, *objects: str, srs: str = "", more: str = "") -> str:
    """A document of some objects."""
    base = f"http://www.opengis.net/citygml/{version}"
    module = "http://www.opengis.net/citygml/{}/" + version
    spaces = {
        "core": base,
        "gml": _GML.get(version, "http://www.opengis.net/gml/3.2"),
        "xlink": "http://www.w3.org/1999/xlink",
        **{p: module.format(n) for p, n in (("bldg", "building"), ("con", "construction"),
           ("gen", "generics"), ("frn", "cityfurniture"), ("veg", "vegetation"), ("tran",
           "transportation"), ("brid", "bridge"), ("app", "appearance"), ("dem", "relief"))},
    }  # fmt: skip
    named = " ".join(f'xmlns:{prefix}="{uri}"' for prefix, uri in spaces.items())
    bounds = f'<gml:boundedBy><gml:Envelope srsName="{srs}" srsDimension="3"/></gml:boundedBy>'
    inner = "".join(f"<core:cityObjectMember>{one}</core:cityObjectMember>" for one in objects)
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<core:CityModel {named}>'
        f"{bounds if srs else ''}{inner}{more}</core:CityModel>\n"
    )
