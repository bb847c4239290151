"""The options of a grid, by name, as axes of a sweep."""

import contextlib
import dataclasses
import functools
import re
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import docstring_parser

from experiments.options.grid import GridConfig
from sim.robot.parameters import RobotParameters
from trackslip.errors import InvalidValueError
from trackslip.logs.schema import NO_UNIT, PURE

ALIASES = {"ground": "ground.source", "slope": "ground.slope"}
"""Axes that are options under another name."""
_NO_AXES = ("radii", "speeds", "threads", "rrd", "out")
_UNIT = re.compile(r"\[([^]]+)\]")
_FLAGS = {"true": True, "false": False}
_WORDS = {int: "an integer", float: "a number", bool: "true or false", str: "a name", Path: "a file"}


def names() -> list[str]:
    """The names of all options that can be an axis; those of nested options contain dots."""
    return [name for name in _leaves(GridConfig) if name not in _NO_AXES]


def with_option(config: Any, name: str, value: object) -> Any:
    """`config` with another value of the option `name`; raises InvalidValueError for a value that isn't allowed."""
    head, _, rest = name.partition(".")
    cls: Any = type(config)
    if not rest:
        return dataclasses.replace(config, **{head: converted(_hints(cls)[head], value, head)})
    try:
        inner = with_option(getattr(config, head), rest, value)
    except InvalidValueError as error:
        raise InvalidValueError(f"{head}.{error.field}", error.value, error.allowed) from error
    return dataclasses.replace(config, **{head: inner})


def option(config: Any, name: str) -> Any:
    """The value of the option `name`."""
    return functools.reduce(getattr, name.split("."), config)


def hint_of(name: str) -> Any:
    """The type of the option `name`."""
    cls, last = _owner(name)
    return _hints(cls)[last]


def explained(name: str) -> tuple[str, str]:
    """Unit and meaning of an axis: the text that `--help` prints for the option, or of the robot's parameter."""
    cls, last = _owner(name)
    text = _texts(cls)[last].removesuffix(".")
    unit = _UNIT.search(text)
    if unit is None:
        return (PURE if {int, float} & {_hints(cls)[last], *typing.get_args(_hints(cls)[last])} else NO_UNIT), text
    about = " ".join(_UNIT.sub("", text).split())
    return (PURE if unit[1] == "-" else unit[1]), about or last


def converted(hint: Any, value: object, name: str) -> Any:
    """`value`, text or from TOML, as the type `hint`; raises InvalidValueError where it can't be converted."""
    options = typing.get_args(hint) if typing.get_origin(hint) in (typing.Union, types.UnionType) else (hint,)
    for kind in options:
        with contextlib.suppress(TypeError, ValueError, OverflowError, KeyError):
            return _as(kind, value)
    raise InvalidValueError(name, value, _described(options))


def _as(kind: Any, value: Any) -> Any:
    """`value` as one type; raises TypeError, ValueError, OverflowError or KeyError where it can't be converted."""
    if typing.get_origin(kind) is typing.Literal and value in typing.get_args(kind):
        return value
    if kind is bool:
        return value if isinstance(value, bool) else _FLAGS[value]
    if kind in (int, float) and not isinstance(value, bool):
        number = kind(value)
        if isinstance(value, str) or number == value or number != number:
            return number
    if kind in (str, Path) and isinstance(value, str):
        value.encode()  # an argument may contain surrogates, which can't be stored
        return kind(value)
    raise TypeError


def _owner(name: str) -> tuple[Any, str]:
    """The dataclass that has the option `name` as a field, and the field's name."""
    cls: Any = GridConfig
    if name.startswith("robot."):
        cls, name = RobotParameters, name.removeprefix("robot.")
    *path, last = name.split(".")
    for part in path:
        cls = _hints(cls)[part]
    return cls, last


def _leaves(cls: Any) -> list[str]:
    found = []
    for name, hint in _hints(cls).items():
        found += [f"{name}.{leaf}" for leaf in _leaves(hint)] if dataclasses.is_dataclass(hint) else [name]
    return found


@functools.cache
def _hints(cls: Any) -> dict[str, Any]:
    hints = typing.get_type_hints(cls)
    return {field.name: hints[field.name] for field in dataclasses.fields(cls)}


@functools.cache
def _texts(cls: Any) -> Mapping[str, str]:
    """The docstring of each field of a dataclass, read as tyro reads it for `--help`."""
    documented = [docstring_parser.parse_from_object(own) for own in reversed(cls.__mro__[:-1])]  # without object
    fields = (field for one in documented for field in one.params)
    return {field.arg_name: " ".join((field.description or "").split()) for field in fields}


def _described(options: typing.Iterable[Any]) -> str:
    words = [[_WORDS[kind]] if kind in _WORDS else typing.get_args(kind) for kind in options]  # or those of a Literal
    return " or ".join(str(word) for several in words for word in several)
