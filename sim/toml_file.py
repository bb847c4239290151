"""Frozen dataclasses from TOML files, with one-line errors that give the file, the field and what is allowed."""

from __future__ import annotations

import dataclasses
import functools
import os.path
import re
import reprlib
import tomllib
import typing
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, TypeVar

from trackslip.errors import InvalidValueError, SettingsFileError, require
from trackslip.files import read_text, reason

T = TypeVar("T")

_MOST = 1_000_000  # bytes of a file of settings
_DEEPEST = 32  # keys nested, as in a.b.c = 1; parsing takes a time that grows as its square
_TOO_DEEP = re.compile(rf"""(?<![\w"'-])(?:[\w"'-]++[ \t]*+\.[ \t]*+){{{_DEEPEST + 1}}}""")
_type_hints = functools.cache(typing.get_type_hints)


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a TOML file; raises SettingsFileError for a file that can't be read."""
    try:
        text = read_text(path, _MOST)
        if _TOO_DEEP.search(text):
            raise tomllib.TOMLDecodeError(f"keys nested more than {_DEEPEST} deep")
        table = tomllib.loads(text)
    except OSError as error:
        raise SettingsFileError(f"{path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise SettingsFileError(f"{path}: {reason(error)}") from error
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise SettingsFileError(f"{path}: not TOML ({reason(error)})") from error
    except ValueError as error:  # the only one that isn't tomllib's own
        raise SettingsFileError(f"{path}: not TOML (a number has too many digits)") from error
    if not table:
        raise SettingsFileError(f"{path}: no settings in it")
    return table


def read_named(field: str, source: str, names: Iterable[str]) -> dict[str, Any]:
    """Read the TOML file `source`, which is none of the `names`; raises InvalidValueError if it is no file either."""
    path = Path(source)
    is_file = source and (path.suffix.lower() == ".toml" or os.path.exists(path))  # Path.exists fails for long names
    require(is_file, field, source, f"one of {', '.join(names)}, or a .toml file")
    return read_toml(path)


def build(cls: type[T], table: object, where: str, base: T | None = None) -> T:
    """Build a frozen dataclass whose fields are numbers, texts, paths, dataclasses, and tuples of these or tuples.

    Args:
        cls: the dataclass.
        table: field -> value; missing fields are taken from `base`, or are the defaults.
        where: file, and place in it, for error messages.
        base: the instance to change.

    Raises:
        SettingsFileError: for unknown or missing fields and values that aren't allowed.
    """
    if not isinstance(table, Mapping):
        raise SettingsFileError(f"{where}: {reprlib.repr(table)} is not a table")
    hints = _type_hints(cls)  # type: ignore[arg-type]
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
    if isinstance(hint, UnionType):  # with None, which TOML lacks
        if value is None:
            return None
        (hint,) = (part for part in typing.get_args(hint) if part is not NoneType)
    if hint is float:
        return _number(value, where, name)
    if hint in (int, str):
        what = "a whole number" if hint is int else "a text"
        if not isinstance(value, hint) or isinstance(value, bool):
            raise SettingsFileError(f"{where}: {name} = {reprlib.repr(value)}: must be {what}")
        return value
    if hint is Path:
        return Path(_value(str, value, where, name))
    if dataclasses.is_dataclass(hint):
        return build(hint, value, f"{where}: {name}")  # type: ignore[arg-type]
    of = typing.get_args(hint)[0]
    if not isinstance(value, list | tuple):
        raise SettingsFileError(f"{where}: {name} = {reprlib.repr(value)}: must be a list")
    if dataclasses.is_dataclass(of):
        return tuple(build(of, item, f"{where}: {name}[{k}]") for k, item in enumerate(value))  # type: ignore[arg-type]
    if typing.get_origin(of) is tuple:
        return tuple(_value(of, item, where, f"{name}[{k}]") for k, item in enumerate(value))
    return tuple(_value(of, item, where, name) for item in value)


def _number(value: object, where: str, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise SettingsFileError(f"{where}: {name} = {reprlib.repr(value)}: must be a number")
    try:
        return float(value)
    except OverflowError as error:
        raise SettingsFileError(f"{where}: {name} = {reprlib.repr(value)}: must be a number below 1e308") from error
