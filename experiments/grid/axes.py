"""The axes of a sweep and their values: any option of a grid by its name, and a few axes that are no options."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import math
import re
import types
import typing
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import docstring_parser

from experiments.common.options import Distinct, option
from experiments.grid.config import Config
from experiments.simulate.grid_options import GridConfig
from sim.robot.parameters import RobotParameters
from sim.toml_file import read_toml
from trackslip.errors import InvalidValueError, SettingsFileError, require_at_most, require_positive
from trackslip.logs.schema import NO_UNIT, PURE, Column

ALIASES = {"ground": "ground.source", "slope": "ground.slope"}
"""Options that are axes under a shorter name; `--vary` takes both."""
AXES = {
    column.name: column
    for column in (
        Column("radius", "m", "radius of the no-slip command"),
        Column("speed", "m/s", "speed of the no-slip command"),
        Column("friction_ratio", PURE, "friction across the track over friction along it"),
        Column("slope", "rad", "angle of the ground to the horizontal"),
        Column("ground", NO_UNIT, "name or file of the ground"),
        Column("seed", NO_UNIT, "root of all random numbers"),
    )
}
"""Axes that are not options; options are described by their help."""
MAX_RUNS = 1_000_000
_POSITIVE = ("radius", "speed", "friction_ratio")  # axes that are no options
_NO_AXES = ("radii", "speeds", "threads", "rrd", "out", "robot", "robot.radius_error", *ALIASES.values())
_MAX_RATIO = 100.0
_UNIT = re.compile(r"\[([^]]+)\]")
_WORDS = {int: "an integer", float: "a number", bool: "true or false", str: "a name", Path: "a file"}


@functools.cache
def known() -> dict[str, tuple[Any, Column]]:
    """Every axis by its name, with the type of its values, and its unit and meaning: for an option, those of `--help`.

    The names of nested options contain dots; those of the robot's parameters begin with "robot.".
    """
    options, parameters = _fields(GridConfig), _fields(RobotParameters, "robot.")
    special = {name: (float, AXES[name]) for name in _POSITIVE}
    special |= {name: (options[long][0], AXES[name]) for name, long in ALIASES.items()}
    found = {
        name: one
        for name, one in (special | parameters | options).items()
        if name not in _NO_AXES and not name.startswith("robot.drive.")
    }
    return found | {"seed": (int, AXES["seed"])}


def _fields(cls: Any, prefix: str = "") -> dict[str, tuple[Any, Column]]:
    """The fields of a dataclass and of the dataclasses in it: their types, and what their docstrings say."""
    hints = typing.get_type_hints(cls)
    documented = [docstring_parser.parse_from_object(own) for own in reversed(cls.__mro__[:-1])]  # as tyro reads them
    texts = {field.arg_name: " ".join((field.description or "").split()) for one in documented for field in one.params}
    found: dict[str, tuple[Any, Column]] = {}
    for field in dataclasses.fields(cls):
        hint, name = hints[field.name], prefix + field.name
        if dataclasses.is_dataclass(hint):
            found |= _fields(hint, f"{name}.")
            continue
        text = texts[field.name].removesuffix(".")
        about = " ".join(_UNIT.sub("", text).split()) or field.name
        unit = match[1] if (match := _UNIT.search(text)) else ""
        is_number = {int, float} & {hint, *typing.get_args(hint)}
        pure = unit == "-" or (is_number and not unit)
        found[name] = hint, Column(name, PURE if pure else unit or NO_UNIT, about)
    return found


def axes_of(config: Config) -> dict[str, tuple[Any, ...]]:
    """The values of each axis, in the order of the loops: radius and speed are the innermost.

    Raises InvalidValueError or SettingsFileError, which name the axis and what is allowed.
    """
    given: dict[str, tuple[Any, ...]] = {}

    def add(name: str, values: Iterable[Any], source: str, called: str) -> None:
        axis = next((short for short, long in ALIASES.items() if name == long), name)
        if axis in given:
            raise InvalidValueError(source, name, "an axis that is given once")
        given[axis] = _checked(axis, tuple(values), called)

    for axis, named in (("ground", "grounds"), ("seed", "seeds")):
        if values := getattr(config, named):
            add(axis, values, named, named)
    for text in config.vary or ():
        name, equals, listed = text.partition("=")
        if not equals:
            raise InvalidValueError("vary", text, "NAME=VALUE,VALUE,...")
        add(name, (part.strip() for part in listed.split(",")), "vary", f"vary {name}")
    if config.sweep is not None:
        from_file = list(_flat(read_toml(config.sweep)))
        if not from_file:
            raise SettingsFileError(f"{config.sweep}: defines no axis")
        try:
            for name, values in from_file:
                add(name, values if isinstance(values, list) else (values,), "axis", name)
        except InvalidValueError as error:
            raise SettingsFileError(f"{config.sweep}: {error}") from error
    _refuse_replaced(config, given)
    drive = {"radius": given.pop("radius", config.radii), "speed": given.pop("speed", config.speeds)}
    axes = {**given, **drive}
    count = math.prod(len(values) for values in axes.values())
    if count > MAX_RUNS:
        raise InvalidValueError("runs", count, f"at most {MAX_RUNS:,}: the product of {', '.join(axes)}")
    return axes


def _refuse_replaced(config: Config, given: Mapping[str, Any]) -> None:
    """Raise InvalidValueError for an option whose value an axis replaces."""
    defaults = type(config)()
    for name in (name for name in given if name != "friction_ratio" and not name.startswith("robot.")):
        replaced = {"radius": "radii", "speed": "speeds", **ALIASES}.get(name, name)
        if option(config, replaced) != option(defaults, replaced):
            allowed = f"left out where {name} is an axis"
            raise InvalidValueError(replaced.removesuffix(".source"), option(config, replaced), allowed)
    if "friction_ratio" in given and ("ground.across" in given or config.ground.across is not None):
        raise InvalidValueError("friction_ratio", given["friction_ratio"], "left out where ground.across is given")


def _checked(name: str, values: tuple[Any, ...], called: str) -> tuple[Any, ...]:
    """An axis' values, converted to its type; raises InvalidValueError, which calls them `called`."""
    if name not in known():
        raise InvalidValueError("axis", name, f"one of {', '.join(known())}")
    taken = tuple(_converted(known()[name][0], value, called) for value in values)
    Distinct().check(called, taken)
    for value in taken if name in _POSITIVE else ():
        require_positive(called, value)
        if name == "friction_ratio":
            require_at_most(called, value, _MAX_RATIO)
    return taken


def _flat(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """The entries of a nested table, with dotted names."""
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def _converted(hint: Any, value: object, name: str) -> Any:
    """`value`, text or from TOML, as the type `hint`; raises InvalidValueError where it can't be converted."""
    several = typing.get_args(hint) if typing.get_origin(hint) in (typing.Union, types.UnionType) else (hint,)
    kinds = [kind for kind in several if kind is not type(None)]
    for kind in kinds:
        with contextlib.suppress(ValueError, KeyError, OverflowError):
            return _from_text(kind, str(value).lower() if isinstance(value, bool) else str(value))
    words = (_WORDS.get(kind) or " or ".join(typing.get_args(kind)) for kind in kinds)  # the latter of a Literal
    raise InvalidValueError(name, value, " or ".join(words))


def _from_text(kind: Any, text: str) -> Any:
    """`text` as one type; raises ValueError, OverflowError or KeyError where it can't be converted."""
    text.encode()  # an argument may contain surrogates, which can't be stored
    if kind is bool:
        return {"true": True, "false": False}[text]
    if typing.get_origin(kind) is typing.Literal:
        return {str(one): one for one in typing.get_args(kind)}[text]
    return kind(text)
