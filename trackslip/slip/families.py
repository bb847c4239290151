"""The families of slip laws that can be fitted: free parameters, limits and starting values.

To add a family, write a law in `trackslip.slip` and an entry here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from trackslip.errors import InvalidValueError
from trackslip.kinematics import Array, RobotGeometry
from trackslip.slip.base import SlipLaw
from trackslip.slip.constant import Constant, NoSlip
from trackslip.slip.exponential import Exponential, ExponentialSpeed
from trackslip.slip.icr import ConstantIcr, IcrSides
from trackslip.slip.icr_load import MAX_COMPLIANCE, IcrLoad
from trackslip.slip.power import Hyperbola, Power
from trackslip.slip.turn_loss import TurnLoss


@dataclass(frozen=True)
class Parameter:
    """A free parameter of a family."""

    starts: tuple[float, ...]
    """Starting values: fits start from the first of each parameter, then from the second of each, and so on."""
    low: float
    """Lower limit."""
    high: float
    """Upper limit."""
    scale: float
    """Size of a significant change."""
    unit: str
    """Unit as printed; empty for a pure number. For lengths (m) the values above are in half gauges."""


@dataclass(frozen=True)
class LawFamily:
    """Slip laws that differ only in the values of their parameters."""

    title: str
    """A short description."""
    parameters: Mapping[str, Parameter]
    """Free parameters by name, in the order of their values in arrays."""
    build: Callable[[Mapping[str, Any], RobotGeometry], SlipLaw]
    """Builds a law from values of the parameters: numbers, or arrays of one shape."""
    loaded: bool = False
    """Whether slip depends on the traction per unit load, which runs then have to tell."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of their values in arrays."""
        return tuple(self.parameters)

    def limits(self, half_gauge: float) -> Array:
        """Lower limits, upper limits and scales (3, p) for a robot with this half gauge [m]."""
        rows = [(p.low, p.high, p.scale) for p in self.parameters.values()]
        return (np.array(rows).reshape(-1, 3) * self._units(half_gauge)[:, None]).T

    def starts(self, half_gauge: float) -> Array:
        """Starting values (K, p) of fits."""
        most = max((len(p.starts) for p in self.parameters.values()), default=1)
        rows = [[p.starts[k % len(p.starts)] for p in self.parameters.values()] for k in range(most)]
        return np.array(rows, float).reshape(most, -1) * self._units(half_gauge)

    def under(self, load: Array | None) -> LawFamily:
        """The family of the laws under tractions per unit load (...) [-]; the same for laws without load."""
        if not self.loaded or load is None:
            return self

        def build(values: Mapping[str, Any], geometry: RobotGeometry) -> SlipLaw:
            law = self.build(values, geometry)
            assert isinstance(law, IcrLoad)
            return law.under(load)

        return replace(self, build=build)

    def law(self, values: Array, geometry: RobotGeometry) -> SlipLaw:
        """The law with parameters (..., p): many laws of shape (...) at once."""
        return self.build({name: values[..., k] for k, name in enumerate(self.names)}, geometry)

    def _units(self, half_gauge: float) -> Array:
        return np.array([half_gauge if p.unit == "m" else 1.0 for p in self.parameters.values()])


def _build(kind: Callable[..., SlipLaw], gauge: bool = False) -> Callable[[Mapping[str, Any], RobotGeometry], SlipLaw]:
    """Builds laws of a kind from their parameters and, with `gauge`, the robot's half gauge."""
    return lambda p, geometry: kind(**p, half_gauge=geometry.half_gauge) if gauge else kind(**p)


_SLIP_OUTER = Parameter((0.05,), -2.0, 0.99, 0.1, "")
_SLIP_INNER = Parameter((-0.1,), -20.0, 0.99, 0.1, "")
_DECAY = Parameter((-0.5, -2.0, -6.0), -50.0, -1e-3, 1.0, "1/m")
_EXPONENT = Parameter((-1.0, -0.3, -3.0), -50.0, -1e-3, 1.0, "")
_GROWTH = Parameter((0.0,), -20.0, 20.0, 0.1, "s/m")
_OFFSET = Parameter((0.3, 0.0, 2.0), -0.99, 50.0, 0.3, "m")
_RADIUS_ERROR = Parameter((0.0,), -0.5, 0.5, 0.01, "")
_COMPLIANCE = Parameter((0.05,), 0.0, MAX_COMPLIANCE, 0.05, "")
_TURN_COMPLIANCE = Parameter((1.0,), 0.0, 20.0, 0.3, "m")
_TURN_LOSS = Parameter((0.0, 0.5), -1.0, 0.99, 0.1, "")

_CONSTANT = {"slip_outer": _SLIP_OUTER, "slip_inner": _SLIP_INNER}
_EXPONENTIAL = {"alpha_outer": _SLIP_OUTER, "beta_outer": _DECAY, "alpha_inner": _SLIP_INNER, "beta_inner": _DECAY}
_SPEED = _EXPONENTIAL | {"gamma_outer": _GROWTH, "gamma_inner": _GROWTH}
_POWER = _EXPONENTIAL | {"beta_outer": _EXPONENT, "beta_inner": _EXPONENT}
_HYPERBOLA = {
    "size": Parameter((0.3, 0.05, 1.0), -20.0, 50.0, 0.3, "m"),
    "pole": Parameter((1.3, 0.5, 2.0), 0.0, 50.0, 0.3, "m"),
}
_RADIUS = {"offset": _OFFSET, "radius_error": _RADIUS_ERROR}
_LOSS = _RADIUS | {"turn_loss": _TURN_LOSS}
_LOAD = _RADIUS | {"compliance": _COMPLIANCE, "turn_compliance": _TURN_COMPLIANCE}
_SIDES = {f"{name}_{side}": parameter for name, parameter in _RADIUS.items() for side in ("left", "right")}

FAMILIES: dict[str, LawFamily] = {
    "none": LawFamily("no slip", {}, _build(NoSlip)),
    "constant": LawFamily("the same slip at every radius", _CONSTANT, _build(Constant)),
    "exponential": LawFamily("exponential in radius, the paper's", _EXPONENTIAL, _build(Exponential)),
    "exponential_speed": LawFamily("exponential in radius, with a term of speed", _SPEED, _build(ExponentialSpeed)),
    "power": LawFamily("power of radius", _POWER, _build(Power, gauge=True)),
    "hyperbola": LawFamily("hyperbola with a free pole", _HYPERBOLA, _build(Hyperbola)),
    "icr": LawFamily("constant ICR", {"offset": _OFFSET}, _build(ConstantIcr, gauge=True)),
    "icr_radius": LawFamily(
        "constant ICR, with an error of the effective sprocket radius", _RADIUS, _build(ConstantIcr, gauge=True)
    ),
    "turn_loss": LawFamily("constant ICR, with a loss of speed in turns", _LOSS, _build(TurnLoss, gauge=True)),
    "icr_load": LawFamily(
        "constant ICR, with slip in proportion to the traction", _LOAD, _build(IcrLoad, gauge=True), loaded=True
    ),
    "icr_sides": LawFamily("constant ICR, left and right different", _SIDES, _build(IcrSides, gauge=True)),
}
"""Families by name, simple ones first."""
TWO_SIDED = ("icr_sides",)
"""Families that need turns to both sides."""


def family(name: str) -> LawFamily:
    """The family called `name`; raises InvalidValueError if there is none."""
    if name not in FAMILIES:
        raise InvalidValueError("law", name, f"one of {', '.join(FAMILIES)}")
    return FAMILIES[name]


def law_from_values(name: str, values: Mapping[str, Any], half_gauge: float) -> SlipLaw:
    """A law of FAMILIES from stored values; raises InvalidValueError for missing or invalid ones."""
    model = family(name)
    geometry = RobotGeometry(half_gauge, sprocket_radius=1.0)
    numbers = {}
    for key, low, high, _ in zip(model.names, *model.limits(half_gauge), strict=True):
        value = values.get(key)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InvalidValueError(f"{name}.{key}", value, "a number")
        numbers[key] = float(value)
        if not low <= numbers[key] <= high:
            raise InvalidValueError(f"{name}.{key}", numbers[key], f"from {low:g} to {high:g}")
    return model.build(numbers, geometry)
