"""The numbers of a law as named constants of a program."""

from __future__ import annotations

from trackslip.slip.families import FAMILIES
from trackslip.slip.stored_laws import StoredLaws

_SIDES = ("left", "right")


def is_linear(law: str) -> bool:
    """Whether a law's sprocket speeds are linear in the twist, as a differential drive's are."""
    return "ros2_control" in FAMILIES[law].targets


def icrs(values: dict[str, float]) -> tuple[tuple[float, float], tuple[float, float]]:
    """D [m] of the left and the right track, and epsilon [-], from the parameters of a linear law."""

    def of(name: str) -> tuple[float, float]:
        left, right = (values.get(name, values.get(f"{name}_{side}", 0.0)) for side in _SIDES)
        return left, right

    return of("offset"), of("radius_error")


def constants_of(stored: StoredLaws, law: str) -> dict[str, tuple[float, str]]:
    """Name -> value and what it is, of all constants that the functions of a law need."""
    values, geometry = stored.values(law), stored.geometry
    radius = {"sprocket_radius": (geometry.sprocket_radius, "r [m]")}
    if is_linear(law):
        return radius | _tracks(values, geometry.half_gauge)
    units = {name: parameter.unit or "-" for name, parameter in FAMILIES[law].parameters.items()}
    half_gauge = {"half_gauge": (geometry.half_gauge, "b [m]")}
    return half_gauge | radius | {name: (value, f"[{units[name]}]") for name, value in values.items()}


def _tracks(values: dict[str, float], half_gauge: float) -> dict[str, tuple[float, str]]:
    """b + D and 1 + epsilon of each track."""
    offsets, errors = icrs(values)
    reach = {f"reach_{side}": (half_gauge + d, "b + D [m]") for side, d in zip(_SIDES, offsets, strict=True)}
    scale = {f"scale_{side}": (1 + error, "1 + epsilon [-]") for side, error in zip(_SIDES, errors, strict=True)}
    return reach | scale
