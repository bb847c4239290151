"""Frozen dataclasses from TOML files and options; one-line errors name the field and its allowed
values.
"""

from __future__ import annotations

import dataclasses
import functools
import os.path
import re
import reprlib
import sys
import tomllib
import typing
from collections.abc import Iterable, Mapping
from numbers import Integral, Real
from pathlib import Path, PurePath
from types import NoneType, UnionType
from typing import Any, Final, TypeVar

from trackslip.errors import InvalidValueError, SettingsFileError, require
from trackslip.files import read_text, reason

T = TypeVar("T")

_MOST: Final = 1_000_000  # largest settings file [bytes]
# Largest number of dots that are not in a number, such as those between parts of a key. The memory
# for one key a.a.a... grows with the square of its parts, and the time for keys below it with their
# product.
_MOST_DOTS: Final = 500
_NUMBER: Final = re.compile(r"(?<![\w.])\d+\.\d+(?![.\d])")
_KINDS: dict[Any, tuple[Any, str]] = {  # by type hint: class of the values, and name in messages
    str: (str, "a text"),
    bool: (bool, "true or false"),
    float: (Real, "a number"),
    int: (Integral, "a whole number"),
    tuple: (tuple, "a list"),
    dict: (dict, "a dictionary"),
    NoneType: (NoneType, "None"),
}
_type_hints = functools.cache(typing.get_type_hints)


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a TOML file; raises SettingsFileError for a file that can't be read."""
    try:
        text = read_text(path, _MOST)
        dots = text.count(".") - len(_NUMBER.findall(text))
        if dots > _MOST_DOTS:
            raise SettingsFileError(
                f"{path}: {dots} dots outside of numbers, must be at most {_MOST_DOTS}"
            )
        table = tomllib.loads(text)
    except OSError as error:
        raise SettingsFileError(f"{path}: {error.strerror}") from error
    except SettingsFileError:
        raise
    except (ValueError, RecursionError) as error:  # errors from decoding text or TOML
        raise SettingsFileError(f"{path}: not TOML ({reason(error)})") from error
    if not table:
        raise SettingsFileError(f"{path}: no settings in it")
    return table


def read_named(field: str, source: str, names: Iterable[str]) -> dict[str, Any]:
    """Read the TOML file `source`; raises InvalidValueError, which lists the known `names`, if it
    isn't a file.
    """
    path = Path(source)
    # Path.exists fails for long names
    is_file = source and (path.suffix.lower() == ".toml" or os.path.exists(path))
    require(is_file, field, source, f"one of {', '.join(names)}, or a .toml file")
    return read_toml(path)


def build(cls: type[T], table: object, where: str, base: T | None = None) -> T:
    """Build a frozen dataclass from a table of its fields; missing fields are those of `base` or
    the defaults.

    Raises SettingsFileError, which begins with `where`, for unknown or missing fields and values
    that aren't allowed; see `converted`.
    """
    if not isinstance(table, Mapping):
        raise SettingsFileError(f"{where}: {reprlib.repr(table)} is not a table")
    hints = _type_hints(cls)  # type: ignore[arg-type]
    known = {f.name: f for f in dataclasses.fields(cls)}  # type: ignore[arg-type]
    for name in table:
        if name not in known:
            raise SettingsFileError(f"{where}: {name} is unknown; known are {', '.join(known)}")
    try:
        values = {
            name: converted(name, value, hints[name], f"{where}: ") for name, value in table.items()
        }
        if base is not None:
            return dataclasses.replace(base, **values)  # type: ignore[type-var]
        for name, f in known.items():
            if (
                name not in values
                and f.default is dataclasses.MISSING
                and f.default_factory is dataclasses.MISSING
            ):
                raise SettingsFileError(f"{where}: {name} is missing")
        return cls(**values)
    except InvalidValueError as error:
        raise SettingsFileError(f"{where}: {error}") from error


def from_options(cls: type[T], options: Mapping[str, Any]) -> T:
    """Build a dataclass from keyword arguments, whose values are converted by `converted`.

    Raises TypeError for unknown names, InvalidValueError for values of the wrong type or that the
    dataclass refuses, SettingsFileError for tables that contain such values.
    """
    hints = _type_hints(cls)  # type: ignore[arg-type]
    for name in options:
        if name not in hints:
            raise TypeError(f"unexpected keyword argument {name!r}: options are {', '.join(hints)}")
    return cls(**options_of("options", options, hints))


def options_of(field: str, options: object, hints: Mapping[str, Any]) -> dict[str, Any]:
    """Return options by name; raises InvalidValueError unless they map names in `hints` to values
    of these types.
    """
    require(isinstance(options, Mapping), field, options, "a dictionary")
    assert isinstance(options, Mapping)
    for name in options:
        require(name in hints, field, name, f"one of {', '.join(hints)}")
    return {name: converted(name, value, hints[name]) for name, value in options.items()}


def converted(name: str, value: Any, hint: Any, where: str = "") -> Any:
    """Convert a value to its type hint: lists to tuples, tables to dataclasses, paths to texts and
    texts to paths.

    A table, which may come from JSON, becomes the hinted dataclass that has its fields. Raises
    InvalidValueError for a value of the wrong type, and SettingsFileError, which begins with
    `where`, for a table that contains such a value.
    """
    if hint is object:
        return value
    parts = typing.get_args(hint) if isinstance(hint, UnionType) else (hint,)
    origins = [typing.get_origin(part) or part for part in parts]
    if isinstance(value, Mapping) and dict not in origins and (kind := _dataclass_of(value, parts)):
        place = f"{where}{name}"
        return (
            kind.from_table(dict(value), place)
            if hasattr(kind, "from_table")
            else build(kind, value, place)
        )
    if isinstance(value, list | tuple) and tuple in origins:
        of, *others = typing.get_args(parts[origins.index(tuple)])
        if others != [...]:
            # a decimal comma makes two numbers of one
            require(len(value) == 1 + len(others), name, value, f"{1 + len(others)} values")
        numbered = dataclasses.is_dataclass(of) or typing.get_origin(of) is tuple
        each = [f"{name}[{k}]" if numbered else name for k in range(len(value))]
        return tuple(converted(own, item, of, where) for own, item in zip(each, value, strict=True))
    if isinstance(value, PurePath) and str in parts:
        return str(value)
    if isinstance(value, str) and Path in parts:
        return Path(value)
    kinds = [_KINDS.get(origin, (origin, f"a {origin.__name__}")) for origin in origins]
    valid = any(isinstance(value, kind) for kind, _ in kinds) and (
        bool in parts or not isinstance(value, bool)
    )
    valid = valid and not (isinstance(value, Integral) and abs(int(value)) > sys.float_info.max)
    require(valid, name, value, " or ".join(words for _, words in kinds))
    return float(value) if float in parts and value is not None else value


def _dataclass_of(table: Mapping[str, Any], parts: Iterable[Any]) -> Any:
    """The dataclass among types and their subclasses that has all fields of a table and the fewest
    others, or None.

    If there is only one candidate, it is returned whatever its fields.
    """
    kinds = [kind for part in parts for kind in _dataclasses(part)]
    if len(kinds) != 1:
        kinds = [kind for kind in kinds if {f.name for f in dataclasses.fields(kind)} >= set(table)]
    return min(kinds, key=lambda kind: len(dataclasses.fields(kind)), default=None)


def _dataclasses(kind: Any) -> list[Any]:
    """The type if it is a dataclass, otherwise its subclasses that are dataclasses."""
    if dataclasses.is_dataclass(kind):
        return [kind]
    return [
        each
        for subclass in getattr(kind, "__subclasses__", list)()
        for each in _dataclasses(subclass)
    ]
