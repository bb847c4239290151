"""Calls of functions whose modules are imported where the call is made."""

import importlib
from typing import Any


def call(function: str, *arguments: Any) -> Any:
    """What a function returns, by its name, `module:function`."""
    module, _, name = function.partition(":")
    return getattr(importlib.import_module(module), name)(*arguments)
