"""The numbers of a law as named constants of a program."""

from __future__ import annotations

from trackslip.slip.families import FAMILIES
from trackslip.slip.stored_laws import StoredLaws

LINEAR = ("none", "icr", "icr_radius", "icr_sides")
"""Laws whose sprocket speeds are linear in the twist."""


def constants_of(stored: StoredLaws, law: str) -> dict[str, tuple[float, str]]:
    """Name -> value and what it is, of all constants that the functions of a law need."""
    values, geometry = stored.values(law), stored.geometry
    radius = {"sprocket_radius": (geometry.sprocket_radius, "r [m]")}
    if law in LINEAR:
        return radius | _tracks(values, geometry.half_gauge)
    units = {name: parameter.unit or "-" for name, parameter in FAMILIES[law].parameters.items()}
    half_gauge = {"half_gauge": (geometry.half_gauge, "b [m]")}
    return half_gauge | radius | {name: (value, f"[{units[name]}]") for name, value in values.items()}


def _tracks(values: dict[str, float], half_gauge: float) -> dict[str, tuple[float, str]]:
    """b + D and 1 + epsilon of each track."""
    found = {}
    for side in ("left", "right"):
        offset = values.get("offset", values.get(f"offset_{side}", 0.0))
        found[f"reach_{side}"] = half_gauge + offset, "b + D [m]"
    for side in ("left", "right"):
        error = values.get("radius_error", values.get(f"radius_error_{side}", 0.0))
        found[f"scale_{side}"] = 1 + error, "1 + epsilon [-]"
    return found
