"""Values of identified laws, with symbols, units and intervals, as text."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from trackslip.identification.answer import TOO_LITTLE
from trackslip.identification.comparison import FittedLaw
from trackslip.identification.result import Identification
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.base import SlipLaw
from trackslip.laws.families import FAMILIES, LawFamily
from trackslip.views.numbers import with_interval
from trackslip.views.symbols import printed_unit, symbol, unit_of

_HALF_GAUGE = "half_gauge"


def value_text(fit: FittedLaw, name: str) -> str:
    """A parameter with its interval, or with the reason why it has none."""
    values = fit.values | getattr(fit, "extras", {})
    ends = fit.interval95.get(name)
    why_none = fit.held.get(name, TOO_LITTLE)
    return with_interval(values[name], ends, unit_of(fit.name, name), why_none=why_none)


def parameter_values(fit: FittedLaw) -> list[tuple[str, str]]:
    """Symbols of a law's parameters, and their values with intervals."""
    return [(symbol(fit.name, key), value_text(fit, key)) for key in fit.values]


def multiplier_values(result: Identification) -> list[tuple[str, str]]:
    """The multipliers of the answer, each with its interval, or with what would determine it."""
    unstated = any(alarm.kind == "multiplier" for alarm in result.alarms)
    undetermined = result.undetermined
    values: list[tuple[str, str]] = []
    for key, gain in result.answer.items():
        if not key.endswith("multiplier"):
            continue
        text = undetermined.get(key)
        if text is None:
            text = with_interval(gain.value, gain[1:], why_none=TOO_LITTLE)
            if key == "wheel_separation_multiplier" and unstated:
                text = f"current × {text}"
        values.append((key, text))
    sides = {key for key in undetermined if key.endswith("wheel_radius_multiplier")}
    if "radius_error" in undetermined and not sides:  # only their difference is determined
        values.append(("mean wheel radius", undetermined["radius_error"]))
    return values


@dataclass(frozen=True)
class LawParameter:
    """A parameter of a law, identified or not."""

    name: str
    symbol: str
    unit: str  # SI unit; empty if dimensionless or unknown
    meaning: str  # empty if unknown
    values: Array  # (n,) value of each law that the object represents

    @property
    def text(self) -> str:
        """The value, or the range of several values, with its unit."""
        factor, unit = printed_unit(self.unit)
        if self.name.startswith("radius_error"):
            factor, unit = 1e2, "%"
        ends = [f"{factor * end:.4g}" for end in (self.values.min(), self.values.max())]
        text = " to ".join(dict.fromkeys(ends)).replace("-", "−")
        count = f" ({self.values.size:,} laws)" if self.values.size > 1 else ""
        return f"{text} {unit}".rstrip() + count


def law_parameters(law: SlipLaw) -> list[LawParameter]:
    """The numbers that define a law: its public attributes, with what its family says of them."""
    found = list[LawParameter]()
    family = _family_of(law)
    name_of_family = next((name for name, each in FAMILIES.items() if each is family), "")
    known: Mapping[str, object] = family.parameters if family else {}
    for name, value in vars(law).items():
        if name.startswith("_") or not _is_numeric(value):
            continue
        values = np.asarray(value, float).reshape(-1)
        if family is not None and name in known:
            parameter = family.parameters[name]
            letter = symbol(name_of_family, name)
            found.append(LawParameter(name, letter, parameter.unit, parameter.meaning, values))
        elif name == _HALF_GAUGE:
            meaning = "half the distance between the tracks' centre lines"
            found.append(LawParameter(name, "b", "m", meaning, values))
        else:
            found.append(LawParameter(name, name, "", "", values))
    return found


def _family_of(law: SlipLaw) -> LawFamily | None:
    """The family whose laws have the class of `law`, with the most parameters; None for a law that
    belongs to none.
    """
    robot = RobotGeometry(half_gauge=1.0, sprocket_radius=1.0)
    families = [
        family
        for family in FAMILIES.values()
        if type(family.law(family.starts(robot.half_gauge)[0], robot)) is type(law)
    ]
    return max(families, key=lambda family: len(family.names), default=None)


def _is_numeric(value: object) -> bool:
    """Whether a value is a number or an array of numbers, and not empty."""
    try:
        array = np.asarray(value)
    except ValueError:
        return False
    return bool(array.size and array.dtype.kind in "iuf")
