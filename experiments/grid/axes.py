"""The axes of a sweep: options of a grid by name, robot parameters, and the friction ratio."""

from __future__ import annotations

import dataclasses
import functools
import re
import typing
from collections.abc import Iterator, Mapping, Sequence
from types import NoneType, UnionType
from typing import Any, Final, Literal

import docstring_parser
import tyro

from experiments.common.options import Distinct, option
from experiments.grid.config import Config
from experiments.simulate.grid_options import GridConfig
from sim.common.settings import converted, read_toml
from sim.robot.parameters import RobotParameters
from trackslip.errors import InvalidValueError, SettingsFileError, require_one_of
from trackslip.logs.schema import NO_UNIT, PURE, Column

SPECIAL: Final = {
    "radius": Column("radius", "m", "radius of the no-slip command"),
    "speed": Column("speed", "m/s", "speed of the no-slip command"),
    "friction_ratio": Column(
        "friction_ratio", PURE, "friction across the track over friction along it"
    ),
}
"""Numeric axes that are neither an option nor a robot parameter."""
_SHORT: Final = {
    "ground.source": "ground",
    "ground.slope": "slope",
    "radii": "radius",
    "speeds": "speed",
}
_NO_AXES: Final = (
    "threads",
    "rrd",
    "out",
    "overwrite",
    "robot",
    "robot.radius_error",
    "robot.drive",
)
_UNIT: Final = re.compile(r" *\[([^]]+)\]")


def option_name(axis: str) -> str | None:
    """The option that an axis replaces; None for an axis that is not an option."""
    if axis == "friction_ratio" or axis.startswith("robot."):
        return None
    return next((name for name, short in _SHORT.items() if short == axis), axis)


@functools.cache
def known() -> dict[str, tuple[Any, Column]]:
    """All axes by name, with the type of their values, and with unit and description as in
    `--help`.

    Names of nested options contain dots; names of robot parameters begin with "robot.".
    """
    axes: dict[str, tuple[Any, Column]] = {
        name: (float, column) for name, column in SPECIAL.items()
    }
    for name, (kind, column) in (_fields(GridConfig) | _fields(RobotParameters, "robot.")).items():
        if name not in _NO_AXES:
            short = _SHORT.get(name, name)
            axes[short] = kind, dataclasses.replace(column, name=short)
    return axes


def _fields(cls: Any, prefix: str = "") -> dict[str, tuple[Any, Column]]:
    """The fields of a dataclass and its nested dataclasses: types, and units and descriptions from
    docstrings.
    """
    bases = [docstring_parser.parse_from_object(base) for base in reversed(cls.__mro__[:-1])]
    texts = {param.arg_name: param.description or "" for base in bases for param in base.params}
    types = typing.get_type_hints(cls)
    fields: dict[str, tuple[Any, Column]] = {}
    for field in dataclasses.fields(cls):
        kind = types[field.name]
        name = prefix + field.name
        if dataclasses.is_dataclass(kind):
            fields |= _fields(kind, f"{name}.")
        elif typing.get_origin(kind) is not tuple:
            text = " ".join(texts[field.name].split()).removesuffix(".")
            match = _UNIT.search(text)
            unit = match[1] if match else NO_UNIT
            is_number = kind in (int, float) or {int, float} & set(typing.get_args(kind))
            if unit == "-" or (is_number and not unit):
                unit = PURE
            fields[name] = kind, Column(name, unit, _UNIT.sub("", text))
    return fields


def axes_of(config: Config) -> dict[str, tuple[Any, ...]]:
    """The values on each axis, in the order of the loops, of which radius and speed are the
    innermost.

    Raises InvalidValueError with the axis' name, SettingsFileError with the sweep file's name, and
    SystemExit after tyro has printed which value of an option it can't read.
    """
    axes = _of_options(config)
    for name, values in of_file(config).items():
        axes.setdefault(name, values)
    for name, values in axes.items():
        Distinct().check(name, values)
        replaced = option_name(name)
        if replaced is not None and option(config, replaced) != option(Config(), replaced):
            raise InvalidValueError(
                replaced, option(config, replaced), f"left out where {name} is an axis"
            )
    drive = {"radius": axes.pop("radius", config.radii), "speed": axes.pop("speed", config.speeds)}
    return axes | drive


def _of_options(config: Config) -> dict[str, tuple[Any, ...]]:
    """The axes that the command line names."""
    given: dict[str, Sequence[str]] = {}
    if config.grounds:
        given["ground"] = config.grounds
    if config.seeds:
        given["seed"] = [str(seed) for seed in config.seeds]
    for text in config.vary or ():
        name, equals, values = text.partition("=")
        if not equals:
            raise InvalidValueError("vary", text, "NAME=VALUE,VALUE,...")
        name = name.replace("-", "_")
        given[_SHORT.get(name, name)] = values.split(",")
    types = {name: tuple[kind, ...] for name, (kind, _) in known().items()}  # type: ignore[valid-type]
    typed_dict: Any = typing.TypedDict
    words = [word for name, values in given.items() for word in (f"--{name}", *values)]
    only_values = (tyro.conf.DisallowNone,)
    parsed = tyro.cli(
        typed_dict("Axes", types, total=False), args=words, add_help=False, config=only_values
    )
    return {name: parsed[name] for name in given}


def of_file(config: Config) -> dict[str, tuple[Any, ...]]:
    """The axes in the sweep file, if there is one; raises SettingsFileError for an unknown axis or
    a value of another type.
    """
    axes = {}
    for key, values in _entries(read_toml(config.sweep)) if config.sweep else ():
        name = _SHORT.get(key, key)
        if name not in known():
            raise SettingsFileError(
                f"{config.sweep}: {key} is unknown; known are {', '.join(known())}"
            )
        kind, _ = known()[name]
        try:
            axes[name] = _converted(key, values if isinstance(values, list) else [values], kind)
        except InvalidValueError as error:
            raise SettingsFileError(f"{config.sweep}: {error}") from error
    return axes


def _converted(name: str, values: list[Any], kind: Any) -> tuple[Any, ...]:
    """Values from a TOML file as values of an option of type `kind`, which may also be None."""
    is_union = typing.get_origin(kind) in (typing.Union, UnionType)
    parts = typing.get_args(kind) if is_union else (kind,)
    of = next(part for part in parts if part is not NoneType)
    if typing.get_origin(of) is Literal:
        choices = typing.get_args(of)
        for value in values:
            require_one_of(name, value, choices)
        return tuple(values)
    return tuple(converted(name, value, of) for value in values)


def _entries(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """The entries in a nested table, with dotted names."""
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from _entries(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value
