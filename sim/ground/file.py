"""Grounds by name, or from a TOML file."""

from __future__ import annotations

import os.path
from pathlib import Path

from sim.ground.ground import Ground
from sim.ground.named import NAMED_GROUNDS
from sim.toml_file import build, read_toml
from trackslip.errors import InvalidValueError, SettingsFileError


def load_ground(source: str) -> Ground:
    """Load a named ground, or a TOML file with fields of `Ground` and, as `base`, the named ground that they change.

    Raises:
        InvalidValueError: for a source that is neither.
        SettingsFileError: for a file that can't be read or has invalid fields.
    """
    if source in NAMED_GROUNDS:
        return NAMED_GROUNDS[source].ground
    path = Path(source)
    if not source or (path.suffix.lower() != ".toml" and not os.path.exists(path)):
        raise InvalidValueError("ground", source, f"one of {', '.join(NAMED_GROUNDS)}, or a .toml file")
    table = read_toml(path)
    base = table.pop("base", "stone")
    if not isinstance(base, str) or base not in NAMED_GROUNDS:
        raise SettingsFileError(f"{source}: base = {base!r}: must be one of {', '.join(NAMED_GROUNDS)}")
    return build(Ground, table, source, NAMED_GROUNDS[base].ground)
