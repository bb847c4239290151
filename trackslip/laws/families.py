"""The families of slip laws that can be fitted, with their parameters, limits, symbols and
deployment targets.

To add a law, write a class in `trackslip.laws` and an entry here; `examples/own_slip_law.py` does
both in one file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

import numpy as np

from trackslip.errors import InvalidValueError, require, require_one_of
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.base import NoSlip, SlipLaw
from trackslip.laws.exponential import Exponential, ExponentialSpeed
from trackslip.laws.icr import MAX_COMPLIANCE, ConstantIcr, DiffDrive, IcrLoad, IcrSides
from trackslip.laws.turn_loss import Centrifugal, TurnLoss, TurnLossSides

_DIFFERENCE: Final = 1e-6  # step of finite differences, relative to the scales of the parameters

Builder = Callable[[Mapping[str, Any], RobotGeometry], SlipLaw]
"""Function that builds a law from parameters by name. It is picklable, as identifications are."""


@dataclass(frozen=True)
class Parameter:
    """A free parameter of a family."""

    starts: tuple[float, ...]
    """Initial values. The first fit starts from the first value of each parameter, the second from
    the second, etc.
    """
    low: float  # lower limit
    high: float  # upper limit
    scale: float  # size of a significant change in the parameter
    # unit as printed; empty if dimensionless. If it is m, the four fields above are in half gauges
    unit: str
    # letter in formulas, without the index of the track; by default the name is used
    symbol: str = ""
    meaning: str = ""  # meaning of the parameter, for reports


@dataclass(frozen=True)
class LawFamily:
    """A set of slip laws that differ only in the values of their parameters."""

    title: str  # a short description
    parameters: Mapping[str, Parameter]  # free parameters by name, in the order of values in arrays
    build: Builder
    """Function that builds a law from parameter values, which are numbers or arrays of the same
    shape.
    """
    targets: tuple[str, ...] = ("json",)  # deployment targets, from `trackslip.deploy.TARGETS`
    # whether slip depends on the traction per unit load, which runs must then contain
    loaded: bool = False
    two_sided: bool = False
    """Whether slip differs between left and right turns, so that fits need turns to both sides."""
    fast: bool = False
    """Whether slip depends on the lateral acceleration, whose effect is visible from a few tenths
    of a m/s².
    """
    of_runs: bool = True  # whether laws of steady runs are compared with laws of the family
    of_drives: bool = True  # whether laws of whole drives are compared with laws of the family

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of values in arrays."""
        return tuple(self.parameters)

    def limits(self, half_gauge: float) -> Array:
        """Lower limits, upper limits and scales (3, p) of the parameters, for a robot with
        `half_gauge` [m].
        """
        rows = [(p.low, p.high, p.scale) for p in self.parameters.values()]
        in_units = np.array(rows).reshape(-1, 3)
        return (in_units * self._units(half_gauge)[:, None]).T

    def starts(self, half_gauge: float) -> Array:
        """Initial values (K, p) for K fits."""
        fits = max((len(p.starts) for p in self.parameters.values()), default=1)
        # a parameter with fewer values begins again with its first
        rows = [
            [p.starts[fit % len(p.starts)] for p in self.parameters.values()] for fit in range(fits)
        ]
        return np.array(rows, float).reshape(fits, -1) * self._units(half_gauge)

    def under(self, load: Array | None) -> LawFamily:
        """The family at tractions per unit load (..., 2) [-]; the same family if its laws ignore
        load.
        """
        if load is None:
            return self
        return replace(self, build=partial(_built_under, load, self.build))

    def holding(self, values: Mapping[str, float]) -> LawFamily:
        """The family with some of its parameters held at `values`."""
        free = {
            name: parameter for name, parameter in self.parameters.items() if name not in values
        }
        return replace(
            self, parameters=free, build=partial(_built_holding, dict(values), self.build)
        )

    def law(self, values: Array, geometry: RobotGeometry) -> SlipLaw:
        """Build the law with parameters (..., p), which represents many laws of shape (...)."""
        by_name = {name: values[..., k] for k, name in enumerate(self.names)}
        return self.build(by_name, geometry)

    def twist_slopes(self, values: Array, omega: Array, geometry: RobotGeometry) -> Array:
        """Derivatives (m, n, 2, p) of twists at sprocket speeds omega (n, 2) [rad/s] by the values
        (m, p) of m laws.

        They are central differences, just inside a limit for values at it, and 0 where no twist has
        these speeds.
        """
        if not self.names:
            return np.empty((len(values), len(omega), 2, 0))
        low, high, scale = self.limits(geometry.half_gauge)
        step = _DIFFERENCE * scale
        inside = np.clip(values, low + step, high - step)[:, None, :]
        # steps in one parameter at a time, for all laws: (p, 1, 1, p)
        pushes = np.diag(step)[:, None, None, :]
        above = self.law(inside + pushes, geometry).twist(omega, geometry)
        below = self.law(inside - pushes, geometry).twist(omega, geometry)
        slopes = np.moveaxis(above - below, 0, -1) / (2 * step)
        return np.where(np.isfinite(slopes), slopes, 0.0)

    def _units(self, half_gauge: float) -> Array:
        return np.array([half_gauge if p.unit == "m" else 1.0 for p in self.parameters.values()])


def _built_under(
    load: Array, build: Builder, values: Mapping[str, Any], geometry: RobotGeometry
) -> SlipLaw:
    """The law that `build` makes of parameters, at tractions per unit load (..., 2) [-]."""
    return build(values, geometry).under(load)


def _built_holding(
    held: Mapping[str, float],
    build: Builder,
    fitted: Mapping[str, Any],
    geometry: RobotGeometry,
) -> SlipLaw:
    """The law that `build` makes of fitted parameters and of those that are held."""
    return build({**held, **fitted}, geometry)


def _built(
    kind: Callable[..., SlipLaw], values: Mapping[str, Any], geometry: RobotGeometry
) -> SlipLaw:
    """A law of a kind from parameters and, for kinds that have it, the half gauge."""
    has_gauge = "half_gauge" in kind.__dataclass_fields__  # type: ignore[attr-defined]
    if has_gauge:
        return kind(**values, half_gauge=geometry.half_gauge)
    return kind(**values)


_ALPHA_OUTER: Final = Parameter(
    starts=(0.05,),
    low=-2.0,
    high=0.99,
    scale=0.1,
    unit="",
    symbol="α",
    meaning="slip at zero radius",
)
_ALPHA_INNER: Final = replace(_ALPHA_OUTER, starts=(-0.1,), low=-20.0)
_DECAY: Final = Parameter(
    starts=(-0.5, -2.0, -6.0),
    low=-50.0,
    high=-1e-3,
    scale=1.0,
    unit="1/m",
    symbol="β",
    meaning="its decay with radius",
)
_GROWTH: Final = Parameter(
    starts=(0.0,),
    low=-20.0,
    high=20.0,
    scale=0.1,
    unit="s/m",
    symbol="γ",
    meaning="its growth with speed",
)
_OFFSET: Final = Parameter(
    starts=(0.3, 0.0, 2.0),
    low=-0.99,
    high=50.0,
    scale=0.3,
    unit="m",
    symbol="D",
    meaning="distance from a track's centre line outwards to its instantaneous centre of rotation "
    "(ICR)",
)
_RADIUS_ERROR: Final = Parameter(
    starts=(0.0,),
    low=-0.95,
    high=9.0,
    scale=0.01,
    unit="",
    symbol="ε",
    meaning="relative excess of the sprockets' effective radius over the nominal one",
)
_COMPLIANCE: Final = Parameter(
    starts=(0.05,),
    low=0.0,
    high=MAX_COMPLIANCE,
    scale=0.05,
    unit="",
    symbol="C",
    meaning="slip per traction over load, ahead",
)
_TURN_COMPLIANCE: Final = Parameter(
    starts=(1.0,),
    low=0.0,
    high=20.0,
    scale=0.3,
    unit="m",
    symbol="S",
    meaning="slip per traction over load, in turning",
)
_TURN_LOSS: Final = Parameter(
    starts=(0.0, 0.5),
    low=-1.0,
    high=0.99,
    scale=0.1,
    unit="",
    symbol="g",
    meaning="share of the belts' mean speed that a turn costs, the more the sharper it is",
)
_CENTRIFUGAL_SLIP: Final = Parameter(
    starts=(0.05, 0.5),
    low=0.0,
    high=10.0,
    scale=0.1,
    unit="s²/m",
    symbol="κ",
    meaning="slip per lateral acceleration |v w|",
)

_EXPONENTIAL: Final = {
    "alpha_outer": _ALPHA_OUTER,
    "beta_outer": _DECAY,
    "alpha_inner": _ALPHA_INNER,
    "beta_inner": _DECAY,
}
_RADIUS: Final = {"offset": _OFFSET, "radius_error": _RADIUS_ERROR}
_LOSS: Final = _RADIUS | {"turn_loss": _TURN_LOSS}
_RADIUS_SIDES: Final = {"radius_error_left": _RADIUS_ERROR, "radius_error_right": _RADIUS_ERROR}
_PROGRAMS: Final = ("json", "c", "python")
_EVERYTHING: Final = ("ros2_control", "ros_control", *_PROGRAMS)

# family of the gains that people compute by hand, with which other laws are compared
GAINS: Final = "two_gains"
# family of the law that gives the multipliers if the radii of left and right differ. It isn't
# compared with other laws: an offset of the sensor lets it predict the same motion as icr_sides
DIFF_DRIVE: Final = "diff_drive"
FAMILIES: Final[dict[str, LawFamily]] = {
    "none": LawFamily("no slip", {}, partial(_built, NoSlip), _EVERYTHING),
    "exponential": LawFamily(
        "exponential in radius, the paper's",
        _EXPONENTIAL,
        partial(_built, Exponential),
        of_drives=False,
    ),
    "exponential_speed": LawFamily(
        "exponential in radius, with a term of speed",
        _EXPONENTIAL | {"gamma_outer": _GROWTH, "gamma_inner": _GROWTH},
        partial(_built, ExponentialSpeed),
        of_drives=False,
    ),
    "icr": LawFamily(
        "constant ICR",
        {"offset": _OFFSET},
        partial(_built, ConstantIcr),
        _EVERYTHING,
        of_drives=False,
    ),
    "icr_radius": LawFamily(
        "constant ICR, with an error of the effective sprocket radius",
        _RADIUS,
        partial(_built, ConstantIcr),
        _EVERYTHING,
    ),
    GAINS: LawFamily(
        "constant ICR, from gains of speed and yaw rate by regression",
        _RADIUS,
        partial(_built, ConstantIcr),
        _EVERYTHING,
        of_runs=False,
        of_drives=False,
    ),
    DIFF_DRIVE: LawFamily(
        "differential drive: constant ICR, with ε of each side",
        {"offset": _OFFSET, **_RADIUS_SIDES},
        partial(_built, DiffDrive),
        _EVERYTHING,
        of_runs=False,
        of_drives=False,
    ),
    "turn_loss": LawFamily(
        "constant ICR, with a loss of speed in turns", _LOSS, partial(_built, TurnLoss), _PROGRAMS
    ),
    "turn_loss_sides": LawFamily(
        "constant ICR, with a loss of speed in turns and ε of each side",
        {"offset": _OFFSET, **_RADIUS_SIDES, "turn_loss": _TURN_LOSS},
        partial(_built, TurnLossSides),
        _PROGRAMS,
        two_sided=True,
    ),
    "centrifugal": LawFamily(
        "constant ICR, with a loss of speed in turns and slip in proportion to the lateral "
        "acceleration",
        _LOSS | {"centrifugal_slip": _CENTRIFUGAL_SLIP},
        partial(_built, Centrifugal),
        fast=True,
    ),
    "icr_load": LawFamily(
        "constant ICR, with slip in proportion to the traction",
        _RADIUS | {"compliance": _COMPLIANCE, "turn_compliance": _TURN_COMPLIANCE},
        partial(_built, IcrLoad),
        loaded=True,
        of_drives=False,
    ),
    "icr_sides": LawFamily(
        "constant ICR, left and right different",
        {"offset_left": _OFFSET, "offset_right": _OFFSET, **_RADIUS_SIDES},
        partial(_built, IcrSides),
        _EVERYTHING,
        two_sided=True,
    ),
}
"""Families by name, the simplest first."""


def drive_laws() -> tuple[str, ...]:
    """Names of the families whose laws are fitted to whole drives."""
    return tuple(name for name, family in FAMILIES.items() if family.of_drives)


def family(name: str) -> LawFamily:
    """The family called `name`. Raises InvalidValueError for an unknown name."""
    require_one_of("law", name, FAMILIES)
    return FAMILIES[name]


def law_from_values(name: str, values: Mapping[str, Any], half_gauge: float) -> SlipLaw:
    """Build a law of the family `name` from stored values. Raises InvalidValueError for missing or
    invalid values.
    """
    model = family(name)
    geometry = RobotGeometry(half_gauge, sprocket_radius=1.0)
    numbers = {}
    for key, low, high, _ in zip(model.names, *model.limits(half_gauge), strict=True):
        field = f"{name}.{key}"
        value = values.get(key)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InvalidValueError(field, value, "a number")
        number = float(value)
        require(low <= number <= high, field, number, f"from {low:g} to {high:g}")
        numbers[key] = number
    return model.build(numbers, geometry)
