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

from trackslip.errors import InvalidValueError, SettingsFileError, one_of, require, require_one_of
from trackslip.files import read_text, reason

T = TypeVar("T")

_MAX_SIZE: Final = 1_000_000  # of a settings file [bytes]
# Largest number of dots that are not in a number, such as those between parts of a key. The memory
# for one key a.a.a... grows with the square of its parts, and the time for keys below it with their
# product.
_MAX_DOTS: Final = 500
_NUMBER: Final = re.compile(r"(?<![\w.])\d+\.\d+(?![.\d])")
# by type hint: class of the values, and name in messages
_KINDS: Final[dict[Any, tuple[Any, str]]] = {
    str: (str, "a text"),
    bool: (bool, "true or false"),
    float: (Real, "a number"),
    int: (Integral, "a whole number"),
    tuple: (tuple, "a list"),
    dict: (dict, "a dictionary"),
    Path: (Path, "a text"),
    NoneType: (NoneType, "None"),
}
_type_hints = functools.cache(typing.get_type_hints)


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a TOML file; raises SettingsFileError for a file that can't be read."""
    try:
        text = read_text(path, _MAX_SIZE)
        dots = text.count(".") - len(_NUMBER.findall(text))
        if dots > _MAX_DOTS:
            raise SettingsFileError(
                f"{path}: {dots} dots outside of numbers, must be at most {_MAX_DOTS}"
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
    require(is_file, field, source, one_of(names, source, ", or a .toml file"))
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
            # what isn't compared is no setting, but says where one comes from
            names = [field.name for field in known.values() if field.compare]
            raise SettingsFileError(f"{where}: {name} is unknown; known are {', '.join(names)}")
    try:
        values = {}
        for name, value in table.items():
            values[name] = converted(name, value, hints[name], f"{where}: ")
        if base is not None:
            return dataclasses.replace(base, **values)  # type: ignore[type-var]
        for name, f in known.items():
            if name not in values and not _has_default(f):
                raise SettingsFileError(f"{where}: {name} is missing")
        return cls(**values)
    except InvalidValueError as error:
        raise SettingsFileError(f"{where}: {error}") from error


def _has_default(field: dataclasses.Field[Any]) -> bool:
    missing = dataclasses.MISSING
    return field.default is not missing or field.default_factory is not missing


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
        require_one_of(field, name, hints)
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
    # the types in a union, and their classes: tuple for tuple[float, ...]
    types = typing.get_args(hint) if isinstance(hint, UnionType) else (hint,)
    classes = [typing.get_origin(kind) or kind for kind in types]
    if isinstance(value, Mapping) and dict not in classes:
        dataclass = _dataclass_of(value, types)
        if dataclass is not None:
            return _from_table(dataclass, value, f"{where}{name}")
    if isinstance(value, list | tuple) and tuple in classes:
        return _tuple(name, value, types[classes.index(tuple)], where)
    if isinstance(value, PurePath) and str in types:
        return str(value)
    if isinstance(value, str) and Path in types:
        return Path(value)
    _require_kind(name, value, classes)
    return float(value) if float in types and value is not None else value


def _from_table(dataclass: Any, table: Mapping[str, Any], where: str) -> Any:
    """A dataclass from a table of its fields, by its own `from_table` if it has one."""
    if hasattr(dataclass, "from_table"):
        return dataclass.from_table(dict(table), where)
    return build(dataclass, table, where)


def _tuple(name: str, values: Any, hint: Any, where: str) -> tuple[Any, ...]:
    """A tuple of converted values. The hint is tuple[item, ...], or has as many equal items as the
    tuple must have.
    """
    item_hint, *others = typing.get_args(hint)
    if others != [...]:
        count = 1 + len(others)
        # a decimal comma makes two numbers of one
        require(len(values) == count, name, values, f"{count} values")
    is_numbered = dataclasses.is_dataclass(item_hint) or typing.get_origin(item_hint) is tuple
    items = []
    for k, item in enumerate(values):
        item_name = f"{name}[{k}]" if is_numbered else name
        items.append(converted(item_name, item, item_hint, where))
    return tuple(items)


def _require_kind(name: str, value: Any, classes: Iterable[Any]) -> None:
    """Raise InvalidValueError unless a value is of one of these classes, and not a whole number
    that no float can hold.
    """
    kinds = [_KINDS.get(each, (each, _word_for(each))) for each in classes]
    is_of_kind = any(isinstance(value, kind) for kind, _ in kinds)
    is_wrong_bool = isinstance(value, bool) and bool not in classes
    is_too_large = isinstance(value, Integral) and abs(int(value)) > sys.float_info.max
    valid = is_of_kind and not is_wrong_bool and not is_too_large
    # a file can't state None, only leave out its field
    words = [word for kind, word in kinds if kind is not NoneType or len(kinds) == 1]
    require(valid, name, value, " or ".join(dict.fromkeys(words)))


def _word_for(kind: Any) -> str:
    """What a file has for a value of a class: a table for a dataclass."""
    return "a table" if dataclasses.is_dataclass(kind) else f"a {kind.__name__}"


def _dataclass_of(table: Mapping[str, Any], types: Iterable[Any]) -> Any:
    """The dataclass among types and their subclasses that has all fields of a table and the fewest
    others, or None.

    If there is only one candidate, it is returned whatever its fields.
    """
    kinds = [kind for each in types for kind in _dataclasses(each)]
    if len(kinds) != 1:
        kinds = [kind for kind in kinds if _field_names(kind) >= set(table)]
    return min(kinds, key=lambda kind: len(dataclasses.fields(kind)), default=None)


def _field_names(kind: Any) -> set[str]:
    return {field.name for field in dataclasses.fields(kind)}


def _dataclasses(kind: Any) -> list[Any]:
    """The type if it is a dataclass, otherwise its subclasses that are dataclasses."""
    if dataclasses.is_dataclass(kind):
        return [kind]
    subclasses: list[Any] = getattr(kind, "__subclasses__", list)()
    return [found for subclass in subclasses for found in _dataclasses(subclass)]
