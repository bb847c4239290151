"""Frozen dataclasses from TOML files, with errors that name the file and the field."""

from __future__ import annotations

import dataclasses
import tomllib
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from trackslip.errors import InvalidValueError, SettingsFileError

T = TypeVar("T")

_MAX_VALUE_TEXT = 80  # value in a message, in characters


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a TOML file; raises SettingsFileError where there is none."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise SettingsFileError(f"{path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise SettingsFileError(f"{path}: not text ({error.reason})") from error
    except (ValueError, RecursionError) as error:  # integers too long and nesting too deep have no error of TOML's
        raise SettingsFileError(f"{path}: not TOML ({error})") from error


def build(cls: type[T], table: object, where: str, base: T | None = None) -> T:
    """An instance of a frozen dataclass whose fields are numbers, pairs of numbers and tuples of such dataclasses.

    Args:
        cls: the dataclass.
        table: field -> value; fields that aren't there are those of `base`, or the defaults.
        where: file, and place in it, for the message of the SettingsFileError that is raised for anything else.
        base: what is changed.
    """
    if not isinstance(table, Mapping):
        raise SettingsFileError(f"{where}: {_shown(table)} is not a table")
    hints = typing.get_type_hints(cls)
    known = {f.name: f for f in dataclasses.fields(cls)}  # type: ignore[arg-type]
    for name in table:
        if name not in known:
            raise SettingsFileError(f"{where}: {name} is unknown; known are {', '.join(known)}")
    values = {name: _value(hints[name], value, where, name) for name, value in table.items()}
    try:
        if base is not None:
            return dataclasses.replace(base, **values)  # type: ignore[type-var]
        for name, f in known.items():
            if name not in values and f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING:
                raise SettingsFileError(f"{where}: {name} is missing")
        return cls(**values)
    except InvalidValueError as error:
        raise SettingsFileError(f"{where}: {error}") from error


def _value(hint: Any, value: object, where: str, name: str) -> Any:
    if hint is float:
        return _number(value, where, name)
    of = typing.get_args(hint)
    if not isinstance(value, list):
        raise SettingsFileError(f"{where}: {name} = {_shown(value)}: must be a list")
    if dataclasses.is_dataclass(of[0]):
        return tuple(build(of[0], item, f"{where}: {name}[{k}]") for k, item in enumerate(value))  # type: ignore[arg-type]
    return tuple(_number(item, where, name) for item in value)


def _number(value: object, where: str, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise SettingsFileError(f"{where}: {name} = {_shown(value)}: must be a number")
    try:
        return float(value)
    except OverflowError as error:
        raise SettingsFileError(f"{where}: {name} = {_shown(value)}: must be a number of moderate size") from error


def _shown(value: object) -> str:
    """A value in a message, cut to a length that fits there."""
    try:
        text = repr(value)
    except ValueError:  # Python writes no integer of thousands of digits
        return "a huge number"
    return text if len(text) <= _MAX_VALUE_TEXT else text[: _MAX_VALUE_TEXT - 3] + "..."
