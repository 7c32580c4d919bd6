"""``urbantwin sensors``: the catalogue, or one sensor of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson

if TYPE_CHECKING:
    from urbantwin.lidar import Sensor

__all__ = ["EXAMPLES", "sensors"]

EXAMPLES = """
urbantwin sensors
urbantwin sensors OS1-128
urbantwin sensors --json | jq '.sensors[].name'
"""


def sensors(
    name: Annotated[
        str | None, typer.Argument(help="A model, or the path of a sensor's .yaml file.")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print names only.")] = False,
    as_json: AsJson = False,
) -> None:
    """List the sensors of the catalogue, or describe one of them."""
    from urbantwin.lidar import sensor, sensor_names

    if name is not None:
        one = sensor(name)
        if as_json:
            Console(as_json=True).result(_everything(one))
        else:
            print(one.name if quiet else _page(one))
        return
    entries = [sensor(known) for known in sensor_names()]
    if as_json:
        Console(as_json=True).result({"sensors": [_summary(entry) for entry in entries]})
    elif quiet:
        print("\n".join(entry.name for entry in entries))
    else:
        print(_table(entries))


def _summary(sensor: Sensor) -> dict[str, Any]:
    return {
        "name": sensor.name,
        "maker": sensor.maker,
        "channels": sensor.channels,
        "elevation_min_deg": float(sensor.elevation_deg.min()),
        "elevation_max_deg": float(sensor.elevation_deg.max()),
        "columns": sensor.columns,
        "columns_options": list(sensor.columns_options),
        "rate_hz": sensor.rate_hz,
        "rate_options": list(sensor.rate_options),
        "range_min_m": sensor.range_min_m,
        "range_max_m": sensor.range_max_m,
    }


def _everything(sensor: Sensor) -> dict[str, Any]:
    return {
        **_summary(sensor),
        "aliases": list(sensor.aliases),
        "reference_reflectivity": sensor.reference_reflectivity,
        "reference_range_m": sensor.reference_range_m,
        "range_sigma_m": sensor.range_sigma_m,
        "range_resolution_m": sensor.range_resolution_m,
        "wavelength_nm": sensor.wavelength_nm,
        "spin": sensor.spin,
        "elevation_deg": sensor.elevation_deg.tolist(),
        "azimuth_offset_deg": sensor.azimuth_offset_deg.tolist(),
        "sources": dict(sensor.sources),
    }


def _table(entries: list[Sensor]) -> str:
    lines = [
        f"{'model':<14}{'maker':<10}{'channels':>8}  {'elevation, deg':<18}"
        f"{'columns':<22}{'Hz':<10}{'range, m':>8}"
    ]
    for entry in entries:
        low, high = entry.elevation_deg.min(), entry.elevation_deg.max()
        lines.append(
            f"{entry.name:<14}{entry.maker:<10}{entry.channels:>8}  "
            f"{f'{low:+.1f} to {high:+.1f}':<18}"
            f"{' '.join(map(str, entry.columns_options)):<22}"
            f"{' '.join(f'{rate:g}' for rate in entry.rate_options):<10}"
            f"{entry.range_max_m:>8g}"
        )
    return "\n".join(lines)


def _page(sensor: Sensor) -> str:
    lines = [f"{sensor.name} ({sensor.maker})"]
    for field, value in _everything(sensor).items():
        if field in ("name", "maker", "sources", "elevation_deg", "azimuth_offset_deg"):
            continue
        if value == []:
            continue
        shown = "not published" if value is None else value
        shown = ", ".join(f"{item}" for item in shown) if isinstance(shown, list) else shown
        lines.append(f"  {field:<24}{shown}")
    lines.append("  channel: elevation, azimuth offset (degrees)")
    table = zip(sensor.elevation_deg, sensor.azimuth_offset_deg, strict=True)
    lines += [f"  {number:>5}: {up:+8.3f} {left:+8.3f}" for number, (up, left) in enumerate(table)]
    lines.append("  sources")
    lines += [f"    {field}: {source}" for field, source in sensor.sources.items()]
    return "\n".join(lines)
