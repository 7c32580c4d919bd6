"""Catalogue of sensors, and datasheets of single sensors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, overload

from urbantwin.interface.command import command
from urbantwin.interface.place import AnyPath
from urbantwin.interface.stage import ShowProgress
from urbantwin.interface.summary import Listing, Summary
from urbantwin.lidar.catalogue import nominal_sensor_names, sensor, sensor_names
from urbantwin.lidar.sensor import Sensor

__all__ = ["Datasheet", "SensorCatalogue", "sensors"]

#: Fields of a sensor with printed names and units, in the order of the page.
_LINES = (
    ("aliases", "also called", ""),
    ("channels", "channels", ""),
    ("rates", "columns x turns per second", ""),
    ("pattern", "pattern", ""),
    ("spin", "turns, from above", ""),
    ("firing_sequence_us", "firing sequence", "us"),
    ("firing_groups", "firings per column", ""),
    ("fire_together", "fire together", ""),
    ("azimuth_step_deg", "azimuth step", "deg"),
    ("range_min_m", "nearest range", "m"),
    ("range_max_m", "farthest range", "m"),
    ("detection_range_10_m", "range at 10 %", "m"),
    ("detection_range_80_m", "range at 80 %", "m"),
    ("range_sigma_m", "range noise, 1 sigma", "m"),
    ("range_resolution_m", "range step", "m"),
    ("wavelength_nm", "wavelength", "nm"),
    ("beam_divergence_deg", "divergence, across x up", "deg"),
    ("beam_origin_m", "beams leave the axis at", "m"),
    ("measured_light", "measured light, times", ""),
    ("measured_sigma_m", "measured range noise", "m"),
    ("measured_faintest", "missed however near, share of white", ""),
    ("measured_divergence_deg", "measured divergence", "deg"),
    ("weak_sigma_m", "range noise at 10 %, at that range", "m"),
    ("overlap_m", "half of the light collected at", "m"),
    ("measured_code_scale", "measured codes, times", ""),
    ("return_modes", "returns", ""),
    ("intensity_scale", "intensity", ""),
    ("intensity_of_white", "intensity of white", ""),
    ("intensity_max", "greatest intensity", ""),
)
_WIDEST = max(len(label) for _, label, _ in _LINES)


@dataclass(frozen=True, eq=False, repr=False)
class Datasheet(Listing):
    """Datasheet of a sensor; printed as a page.

    Attributes:
        sensor: values and arrays: ``elevation_deg``, ``azimuth_offset_deg``, ...
    """

    sensor: Sensor

    @property
    def names(self) -> tuple[str]:
        """Name of the sensor; see `SensorCatalogue.names`."""
        return (self.sensor.name,)

    @classmethod
    def open(cls, path: AnyPath) -> Datasheet:
        """Read a sensor file (.yaml, .json, .csv).

        Raises:
            InputError: the file is missing or wrong.
        """
        return cls(sensor(Path(path)))

    def __repr__(self) -> str:
        """Return the page."""
        return _page(self.sensor)

    def summary(self) -> Summary:
        """Return all values in JSON-compatible form."""
        return Summary(_everything(self.sensor))


class SensorCatalogue(Listing, Mapping[str, Datasheet]):
    """Sensors of the catalogue by name; printed as a table."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the sensors; those without a public beam table come last."""
        return (*sensor_names(), *nominal_sensor_names())

    def __getitem__(self, name: str) -> Datasheet:
        """Return a sensor by its name or an alias.

        Raises:
            KeyError: no sensor has this name.
        """
        if name not in self.names:
            raise KeyError(name)
        return Datasheet(sensor(name))

    def __iter__(self) -> Iterator[str]:
        """Return the names."""
        return iter(self.names)

    def __len__(self) -> int:
        """Return the number of sensors."""
        return len(self.names)

    def __repr__(self) -> str:
        """Return the table."""
        return _table([one.sensor for one in self.values()])

    def summary(self) -> Summary:
        """Return the main values of each sensor in JSON-compatible form."""
        return Summary(sensors=[_summary(one.sensor) for one in self.values()])


@overload
def sensors() -> SensorCatalogue: ...
@overload
def sensors(name: AnyPath) -> Datasheet: ...
@command
def sensors(
    name: AnyPath | None = None,
    *,
    progress: ShowProgress = True,
) -> SensorCatalogue | Datasheet:
    """List sensors, or print all that is known of one.

    Args:
        name: model, or the path of a sensor's file (.yaml, .json, .csv); all models if not given.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: the sensor is unknown.

    Example:
        >>> ut.catalogue.sensors()
        >>> ut.catalogue.sensors("OS1-128").sensor.elevation_deg
        $ urbantwin catalogue sensors OS1-128
    """
    if name is None:
        return SensorCatalogue()
    return Datasheet(sensor(name if isinstance(name, str) else Path(name)))


def _summary(sensor: Sensor) -> dict[str, Any]:
    return {
        "name": sensor.name,
        "maker": sensor.maker,
        "nominal": sensor.name in nominal_sensor_names(),
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
    times, modes = sensor.firing_time_us, sensor.modes
    return {
        **_summary(sensor),
        "aliases": list(sensor.aliases),
        "modes": None if modes is None else [list(mode) for mode in modes],
        "column_rates_hz": None if modes is None else [columns * rate for columns, rate in modes],
        "pattern": _pattern(sensor),
        "column_rate_hz": sensor.column_rate_hz,
        "firing_sequence_us": sensor.firing_sequence_us,
        "firing_groups": sensor.firing_groups,
        "blocks": None if sensor.blocks is None else [list(block) for block in sensor.blocks],
        "azimuth_step_deg": sensor.azimuth_step_deg,
        "reference_reflectivity": sensor.reference_reflectivity,
        "reference_range_m": sensor.reference_range_m,
        "detection_range_10_m": sensor.detection_range_10_m,
        "detection_range_80_m": sensor.detection_range_80_m,
        "range_sigma_m": sensor.range_sigma_m,
        "range_resolution_m": sensor.range_resolution_m,
        "wavelength_nm": sensor.wavelength_nm,
        "beam_divergence_deg": _listed(sensor.beam_divergence_deg),
        "beam_origin_m": sensor.beam_origin_m,
        "measured_light": sensor.measured_light,
        "measured_sigma_m": sensor.measured_sigma_m,
        "measured_faintest": sensor.measured_faintest,
        "measured_divergence_deg": _listed(sensor.measured_divergence_deg),
        "weak_sigma_m": sensor.weak_sigma_m,
        "overlap_m": sensor.overlap_m,
        "measured_code_scale": sensor.measured_code_scale,
        "return_modes": _listed(sensor.return_modes),
        "intensity_scale": sensor.intensity_scale,
        "intensity_of_white": sensor.intensity_of_white,
        "intensity_max": sensor.intensity_max,
        "spin": sensor.spin,
        "elevation_deg": sensor.elevation_deg.tolist(),
        "azimuth_offset_deg": sensor.azimuth_offset_deg.tolist(),
        "firing_time_us": None if times is None else times.tolist(),
        "sources": dict(sensor.sources),
        "unknown": dict(sensor.unknown),
    }


def _listed(values: tuple[Any, ...] | None) -> list[Any] | None:
    return None if values is None else list(values)


def _table(entries: list[Sensor]) -> str:
    lines = [
        f"{'model':<17}{'maker':<12}{'channels':>8}  {'elevation, deg':<18}"
        f"{'columns':<22}{'Hz':<10}{'range, m':>8}"
    ]
    for entry in entries:
        low, high = entry.elevation_deg.min(), entry.elevation_deg.max()
        nominal = "  nominal beams" if entry.name in nominal_sensor_names() else ""
        farthest = "unknown" if entry.range_max_m is None else f"{entry.range_max_m:g}"
        lines.append(
            f"{entry.name:<17}{entry.maker:<12}{entry.channels:>8}  "
            f"{f'{low:+.1f} to {high:+.1f}':<18}"
            f"{' '.join(map(str, entry.columns_options)):<22}"
            f"{' '.join(f'{rate:g}' for rate in entry.rate_options):<10}"
            f"{farthest:>8}{nominal}"
        )
    return "\n".join(lines)


def _page(sensor: Sensor) -> str:
    values = _everything(sensor) | {"rates": _rates(sensor), "fire_together": _blocks(sensor)}
    lines = [f"{sensor.name} ({sensor.maker})"]
    for field, label, unit in _LINES:
        value = values[field]
        if value == [] or (field in {"pattern", "fire_together"} and value is None):
            continue
        why = sensor.unknown.get(field)
        text = "unknown" if value is None else f"{_text(value)} {unit}".rstrip()
        if field.endswith("divergence_deg") and value is not None:
            text = f"{value[0]:g} x {value[1]:g} {unit}"
        elif field == "beam_divergence_deg":
            across, up = sensor.assumed_divergence_deg
            text = f"unknown, {across:g} x {up:g} {unit} are simulated"
        lines.append(f"  {label:<{_WIDEST}}  {text}" + (f" ({why})" if why else ""))
    lines.append("  channel: elevation, azimuth offset (degrees), firing time (us)")
    times = sensor.firing_time_us
    for number, up in enumerate(sensor.elevation_deg):
        fires = "unknown" if times is None else f"{times[number]:.3f}"
        left = sensor.azimuth_offset_deg[number]
        lines.append(f"  {number:>5}: {up:+8.3f} {left:+8.3f} {fires:>9}")
    lines.append("  sources")
    lines += [f"    {field}: {source}" for field, source in sensor.sources.items()]
    if sensor.unknown:
        lines.append("  unknown, or assumed")
        lines += [f"    {field}: {why}" for field, why in sensor.unknown.items()]
    return "\n".join(lines)


def _pattern(sensor: Sensor) -> str | None:
    pattern = sensor.pattern
    if pattern is None:
        return None
    return (
        f"{pattern.name}: {pattern.lines} lines, {pattern.period_s:g} s, "
        f"{sensor.points_per_second:g} points per second"
    )


def _rates(sensor: Sensor) -> str:
    if sensor.modes is None:
        columns = ", ".join(map(str, sensor.columns_options))
        return f"{columns} x {', '.join(f'{rate:g}' for rate in sensor.rate_options)}"
    modes = ", ".join(
        f"{columns} x {rate:g} ({columns * rate:g} columns/s)" for columns, rate in sensor.modes
    )
    return f"{modes}; default {sensor.columns} x {sensor.rate_hz:g}"


def _blocks(sensor: Sensor) -> str | None:
    """Return the groups of channels that fire together, as number ranges."""
    if sensor.blocks is None or sensor.pattern is not None:
        return None
    if len(sensor.blocks) == 1:
        return "all channels of a column"
    if len(sensor.blocks) == sensor.channels:
        return "none: one channel after the other"
    return "; ".join(_runs(block) for block in sensor.blocks)


def _runs(numbers: tuple[int, ...]) -> str:
    """Return ascending numbers as text: ``0-3, 8``."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs)


def _text(value: Any) -> str:  # noqa: ANN401
    if isinstance(value, list):
        return ", ".join(_text(item) for item in value)
    return f"{value:g}" if isinstance(value, float) else f"{value}"
