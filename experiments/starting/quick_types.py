"""Checking the defaults of options in a fraction of the time that typeguard takes to be imported.

tyro compares every default with the type of its option. For unions and tuples it leaves that to typeguard, whose import
takes as long as all else that tyro does.
"""

import types
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, get_args, get_origin

import tyro._resolver

_CHECK = "is_instance"


@contextmanager
def quick_types() -> Iterator[None]:
    """Let tyro look no further into the defaults of tuples than that they are tuples."""
    theirs = getattr(tyro._resolver, _CHECK, None)
    if theirs is None:  # it is private: another version may lack it
        yield
        return

    def is_instance(kind: Any, value: Any) -> bool:
        origin = get_origin(kind)
        if origin is types.UnionType:
            return any(is_instance(one, value) for one in get_args(kind))
        return isinstance(value, tuple) if origin is tuple else theirs(kind, value)

    setattr(tyro._resolver, _CHECK, is_instance)
    try:
        yield
    finally:
        setattr(tyro._resolver, _CHECK, theirs)
