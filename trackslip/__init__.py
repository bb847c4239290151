"""Slip of tracked robots: kinematics, localization, identification and control, usable without a
simulator.

    import trackslip

    found = trackslip.identify("out/grid")
    found.laws[found.best]

The public names are imported when they are first used, so that `import trackslip` is quick.
"""

import importlib

import lazy_loader

_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__all__ = sorted([*__all__, "__version__"])


def __getattr__(name: str) -> object:
    if name == "__version__":
        return importlib.import_module("importlib.metadata").version("trackslip")
    return _public(name)
