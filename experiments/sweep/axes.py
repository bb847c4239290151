"""The axes of a sweep and their values."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

from experiments.options.checks import require_distinct
from experiments.options.grid import SweepConfig
from experiments.sweep.options import ALIASES, converted, hint_of, names, option
from sim.robot.parameters import RobotParameters
from sim.toml_file import read_toml
from trackslip.errors import InvalidValueError, SettingsFileError, require_at_most, require_positive

MAX_RUNS = 1_000_000
_PARAMETERS = tuple(f"robot.{f.name}" for f in dataclasses.fields(RobotParameters) if f.name != "radius_error")
_POSITIVE = ("radius", "speed", "friction_ratio")
_OWN = (*_POSITIVE, *ALIASES, *_PARAMETERS)
_MAX_RATIO = 100.0


def axes_of(config: SweepConfig) -> dict[str, tuple[Any, ...]]:
    """The values of each axis, in the order of the loops: radius and speed are the innermost.

    Raises InvalidValueError or SettingsFileError, which name the axis and what is allowed.
    """
    given: dict[str, tuple[Any, ...]] = {}
    listed_by = {"ground": "grounds", "friction_ratio": "friction_ratio", "slope": "slope", "seed": "seeds"}
    for name, option_name in listed_by.items():
        if values := getattr(config, option_name):
            given[name] = _checked(name, values, option_name)
    for text in config.vary or ():
        name, equals, listed = text.partition("=")
        if not equals:
            raise InvalidValueError("vary", text, "NAME=VALUE,VALUE,...")
        _require_new(given, name, "vary")
        given[name] = _checked(name, tuple(part.strip() for part in listed.split(",")), f"vary {name}")
    from_file = {} if config.sweep is None else _flat(read_toml(config.sweep), str(config.sweep))
    if config.sweep is not None and not from_file:
        raise SettingsFileError(f"{config.sweep}: defines no axis")
    for name, values in from_file.items():
        _require_new(given, name, str(config.sweep))
        try:
            given[name] = _checked(name, tuple(values) if isinstance(values, list) else (values,), name)
        except InvalidValueError as error:
            raise SettingsFileError(f"{config.sweep}: {error}") from error
    for name in [name for name in given if name not in ("friction_ratio", *_PARAMETERS)]:
        replaced = {"radius": "radii", "speed": "speeds", **ALIASES}.get(name, name)
        value = option(config, replaced)
        if value != option(SweepConfig(), replaced):
            raise InvalidValueError(replaced.removesuffix(".source"), value, f"left out where {name} is an axis")
    if "friction_ratio" in given and ("ground.across" in given or config.ground.across is not None):
        raise InvalidValueError("friction_ratio", given["friction_ratio"], "left out where ground.across is given")
    drive = {"radius": given.pop("radius", config.radii), "speed": given.pop("speed", config.speeds)}
    axes = {**given, **drive}
    count = math.prod(len(values) for values in axes.values())
    if count > MAX_RUNS:
        raise InvalidValueError("runs", count, f"at most {MAX_RUNS:,}: the product of {', '.join(axes)}")
    return axes


def _checked(name: str, values: tuple[Any, ...], given: str) -> tuple[Any, ...]:
    """An axis' values, converted to its type; raises InvalidValueError, which calls them `given`."""
    known = [*_OWN, *(n for n in names() if n not in ("robot", *ALIASES.values()))]
    if name not in known:
        raise InvalidValueError("axis", name, f"one of {', '.join(known)}")
    hint = float if name in _POSITIVE else hint_of(ALIASES.get(name, name))
    taken = tuple(converted(hint, value, given) for value in values)
    require_distinct(given, taken)
    for value in taken if name in _POSITIVE else ():
        require_positive(given, value)
        if name == "friction_ratio":
            require_at_most(given, value, _MAX_RATIO)
    return taken


def _require_new(given: Mapping[str, Any], name: str, where: str) -> None:
    if name in given:
        raise InvalidValueError(where, name, "an axis that is given once")


def _flat(table: Mapping[str, Any], where: str, prefix: str = "") -> dict[str, Any]:
    """A nested table with dotted names."""
    found: dict[str, Any] = {}
    for name, value in table.items():
        own = {prefix + name: value}
        for axis, values in (_flat(value, where, f"{prefix}{name}.") if isinstance(value, Mapping) else own).items():
            _require_new(found, axis, where)
            found[axis] = values
    return found
