"""The options that `--help` shows: those that most people need, on one screen."""

import ast
import dataclasses
import functools
import inspect
import textwrap
import typing
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Any

import tyro


def essential(options: type, names: Sequence[str]) -> type:
    """A class with only the options with these names, in this order, to show their help.

    Dots lead to options in a group; `ground.source` is --ground itself.
    """
    fields = [(name.replace(".", "_"), *_option(options, name)) for name in names]
    return dataclasses.make_dataclass(
        options.__name__, fields, kw_only=True, namespace={"__doc__": options.__doc__}
    )


def _option(options: type, name: str) -> tuple[Any, Any]:
    """An option's type, annotated with its flag and its help, and a field with its default."""
    kind = options
    flag = []
    hint: Any = options
    for part in name.split("."):
        kind = _without_annotation(hint)
        hint = typing.get_type_hints(kind, include_extras=True)[part]
        flag.append(_name_in_flag(hint, part))

    field = next(field for field in dataclasses.fields(kind) if field.name == part)
    default = dataclasses.field(default=field.default, default_factory=field.default_factory)
    is_positional = tyro.conf.Positional in _annotations(hint)
    shown = tyro.conf.arg(
        name=None if is_positional else ".".join(filter(None, flag)).replace("_", "-"),
        help=_docstrings(kind)[part],
    )
    return Annotated[hint, shown], default


def _name_in_flag(hint: Any, name: str) -> str:
    """The part of a flag for an option or a group, which is empty for some."""
    given = [getattr(annotation, "name", None) for annotation in _annotations(hint)]
    return next((other for other in given if other is not None), name)


def _annotations(hint: Any) -> tuple[Any, ...]:
    return getattr(hint, "__metadata__", ())


def _without_annotation(hint: Any) -> Any:
    return hint.__origin__ if _annotations(hint) else hint


@functools.cache
def _docstrings(kind: type) -> dict[str, str]:
    """The docstrings of a dataclass's fields by name, each on one line."""
    docstrings = {}
    for each in reversed(kind.__mro__):
        if not dataclasses.is_dataclass(each):
            continue
        (definition,) = ast.parse(textwrap.dedent(inspect.getsource(each))).body
        for statement, after in pairwise(getattr(definition, "body", ())):
            match statement, after:
                case (
                    ast.AnnAssign(target=ast.Name(name)),
                    ast.Expr(value=ast.Constant(str(text))),
                ):
                    docstrings[name] = " ".join(text.split())
    return docstrings
