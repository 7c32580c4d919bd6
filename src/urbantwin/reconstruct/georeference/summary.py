"""What placing did, in lines that a person reads."""

from __future__ import annotations

__all__ = ["summary_of"]

_MOST_POINTS = 12


def summary_of(report: dict[str, object], registration: tuple[str, ...]) -> list[str]:
    """Return a report of `placed` in a few lines: method, accuracy, heights, residuals."""
    first = f"placed by {report['method']}"
    if "crs" in report:
        accuracy = report.get("accuracy_m")
        good = f", good to {accuracy:g} m" if isinstance(accuracy, float) else ""
        first = f"placed by {report['method']}: {report['crs']}{good}"
    lines = [first]
    points = report.get("control_points")
    if isinstance(points, list):
        told = ", ".join(f"{p['name']} {p['residual_m']:.3f} m" for p in points[:_MOST_POINTS])
        more = f" and {len(points) - _MOST_POINTS} more" if len(points) > _MOST_POINTS else ""
        lines.append(f"residuals: {told}{more}; RMS {report['rms_m']:.3f} m")
    axes = [f"{report['up']} is up ({report['up_why']})"] if "up_why" in report else []
    if "unit_m" in report:
        axes.append(f"its unit is {report['unit_m']:g} m ({report['unit_why']})")
    if axes:
        lines.append(", ".join(axes))
    lines += _heights(report)
    return [*lines, *(f"registered: {line}" for line in registration)]


def _heights(report: dict[str, object]) -> list[str]:
    heights = report.get("heights")
    if not isinstance(heights, dict):
        return []
    if "laid_on" in heights:
        return [f"heights: laid on {heights['laid_on']}"]
    anchor = heights["anchor"]
    text = f"heights: {heights['datum']}; the anchor's ground is at {anchor['anchor_m']:.2f} m"
    text += f" ({anchor['datum']}, by {anchor['of']})"
    if "ground_above_site_m" in heights:
        text += f"; its ground lies {heights['ground_above_site_m']:+.2f} m from the site's"
    return [text]
