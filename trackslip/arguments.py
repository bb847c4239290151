"""Checks of the types of arguments, by the annotations of public functions and classes.

`checks_arguments` marks these. An argument whose annotation names a class of trackslip or of its
simulator, such as a `RobotGeometry`, a text or a path must then be what the annotation says.
Numbers and arrays are checked where they are used.
"""

from __future__ import annotations

import functools
import inspect
import os
import types
import typing
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields, is_dataclass
from numbers import Real
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

from trackslip.errors import InvalidValueError

_PACKAGES: Final = ("trackslip", "sim")  # whose classes are checked
_MOST_FIELDS: Final = 3  # most fields of a dataclass that a message lists
_PLAIN: Final[dict[type, str]] = {
    str: "text",
    Path: "a path",
    bool: "True or False",
    int: "a number",
    float: "a number",
}

Marked = TypeVar("Marked", bound=Callable[..., Any])


class Argument(NamedTuple):
    """An argument whose type is checked."""

    position: int
    name: str
    annotation: Any


def checks_arguments(marked: Marked) -> Marked:
    """Let a function raise InvalidValueError, with the argument's name, for an argument of the
    wrong type; for a class, its constructor and its own public methods.
    """
    if not inspect.isclass(marked):
        return typing.cast(Marked, _checking(marked))
    for name, member in [*vars(marked).items()]:
        is_public = not name.startswith("_") or name == "__init__"
        if is_public and isinstance(member, classmethod):
            setattr(marked, name, classmethod(_checking(member.__func__)))
        elif is_public and inspect.isfunction(member):
            setattr(marked, name, _checking(member))
    return marked


def _checking(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function with a check of its arguments before each call."""
    # at the first call, as annotations may name classes that are defined later
    arguments = functools.cache(lambda: arguments_of(function))

    @functools.wraps(function)
    def checked(*args: Any, **kwargs: Any) -> Any:
        for position, name, annotation in arguments():
            if position < len(args):
                value = args[position]
            elif name in kwargs:
                value = kwargs[name]
            else:
                continue
            if not _is(value, annotation):
                raise InvalidValueError(name, value, _described(annotation))
        return function(*args, **kwargs)

    return checked


def arguments_of(function: Callable[..., Any]) -> list[Argument]:
    """The arguments of a function that are checked."""
    hints = typing.get_type_hints(function)
    return [
        Argument(position, name, hints[name])
        for position, name in enumerate(inspect.signature(function).parameters)
        if name in hints and _is_checked(hints[name])
    ]


def _is_checked(annotation: Any) -> bool:
    """Whether arguments with an annotation are checked; those that may be arrays aren't."""
    classes = _classes_in(annotation)
    is_array = any(getattr(kind, "__module__", "").startswith("numpy") for kind in classes)
    return not is_array and any(map(_is_asked_for, classes))


def _classes_in(annotation: Any) -> list[Any]:
    """The classes that an annotation names, in unions and collections, too."""
    parts = typing.get_args(annotation)
    if not parts:
        return [annotation]
    origin = typing.get_origin(annotation)
    if inspect.isclass(origin) and issubclass(origin, Mapping):
        parts = parts[1:]  # keys are names
    return [origin, *(each for part in parts for each in _classes_in(part))]


def _is_asked_for(kind: Any) -> bool:
    """Whether a class decides that an argument is checked: text, paths, and classes of trackslip or
    its simulator.
    """
    if kind in (str, Path):
        return True
    is_own = inspect.isclass(kind) and kind.__module__.partition(".")[0] in _PACKAGES
    return is_own and _is_decidable(kind)


def _is_decidable(kind: type) -> bool:
    """Whether `isinstance` can ask for a class: protocols must allow it."""
    return not _is_protocol(kind) or getattr(kind, "_is_runtime_protocol", False)


def _is_protocol(kind: type) -> bool:
    return bool(getattr(kind, "_is_protocol", False))


def _is(value: object, annotation: Any) -> bool:
    """Whether a value is what an annotation says; True for annotations that can't be checked."""
    origin = typing.get_origin(annotation)
    parts = typing.get_args(annotation)
    if origin in (typing.Union, types.UnionType):
        return any(_is(value, part) for part in parts)
    if inspect.isclass(origin) and issubclass(origin, Mapping):
        return isinstance(value, Mapping) and all(_is(item, parts[1]) for item in value.values())
    if inspect.isclass(origin) and issubclass(origin, Iterable):
        return _is_collection(value, parts[0])
    if annotation in (None, type(None)):
        return value is None
    if annotation is float:
        return isinstance(value, Real)
    if annotation is Path:
        return isinstance(value, os.PathLike)
    if annotation is Any or not inspect.isclass(annotation) or not _is_decidable(annotation):
        return True
    return isinstance(value, annotation)


def _is_collection(value: object, kind: Any) -> bool:
    """Whether a value is a collection of items of a kind; iterators aren't asked for their items,
    which that would take.
    """
    if not isinstance(value, Iterable) or isinstance(value, str | Mapping):
        return False
    return iter(value) is value or all(_is(item, kind) for item in value)


def _described(annotation: Any) -> str:
    """An annotation in words, such as "a RobotGeometry(half_gauge, sprocket_radius) or None"."""
    origin = typing.get_origin(annotation)
    parts = typing.get_args(annotation)
    if origin in (typing.Union, types.UnionType):
        words = list(dict.fromkeys(map(_described, parts)))
        return " or ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
    if inspect.isclass(origin) and issubclass(origin, Mapping):
        return f"a mapping to {_described(parts[1]).removeprefix('a ')}s"
    if inspect.isclass(origin) and issubclass(origin, Iterable):
        return f"several {_described(parts[0]).removeprefix('a ')}s"
    if annotation is type(None):
        return "None"
    if annotation in _PLAIN:
        return _PLAIN[annotation]
    return _with_article(annotation)


def _with_article(kind: type) -> str:
    """The name of a class, with its fields if these are few; for a protocol, with its methods."""
    if _is_protocol(kind):
        methods = [name for name, member in vars(kind).items() if _is_method_of(kind, member)]
        return f"an object with {', '.join(methods)}"
    name = kind.__name__
    article = "an" if name[0] in "AEIOU" else "a"
    if is_dataclass(kind) and 0 < len(fields(kind)) <= _MOST_FIELDS:
        return f"{article} {name}({', '.join(field.name for field in fields(kind))})"
    return f"{article} {name}"


def _is_method_of(kind: type, member: object) -> bool:
    """Whether a member of a protocol is one of its own methods, not of what `typing` adds."""
    return inspect.isfunction(member) and member.__module__ == kind.__module__
