"""Modules that libraries import, and commands hardly ever need: importing them is put off until something asks for one.

SciPy copies all that NumPy offers, its compiler of Fortran among it, and MuJoCo asks for windows: both together take a
tenth of the time in which a command starts.
"""

import importlib
import importlib.util
import sys
from collections.abc import Iterable
from types import ModuleType
from typing import Any

RARE = ("glfw", "numpy.f2py", "numpy.testing")
"""Such modules."""


def put_off(names: Iterable[str] = RARE) -> None:
    """Put placeholders among the modules, each of which imports the real one when something is taken from it.

    Modules that have been imported, or are not installed, are left alone.
    """
    for name in names:
        spec = None if name in sys.modules else importlib.util.find_spec(name)
        if spec is not None:
            placeholder = _Placeholder(name)
            placeholder.__spec__ = spec  # so that it can still be found
            sys.modules[name] = placeholder
            parent, _, own = name.rpartition(".")
            if parent:
                setattr(sys.modules[parent], own, placeholder)


class _Placeholder(ModuleType):
    """Stands for a module until something is taken from it."""

    def __getattr__(self, attribute: str) -> Any:
        name = self.__name__
        if sys.modules.get(name) is self:
            del sys.modules[name]
            importlib.import_module(name)
        return getattr(sys.modules[name], attribute)
