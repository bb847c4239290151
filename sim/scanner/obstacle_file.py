"""Obstacles by name, or from a TOML file."""

from __future__ import annotations

import os.path
from pathlib import Path

from sim.scanner.named_obstacles import NAMED_OBSTACLES
from sim.scanner.obstacles import Obstacles
from sim.toml_file import build, read_toml
from trackslip.errors import InvalidValueError


def load_obstacles(source: str) -> Obstacles:
    """Load named obstacles, or those of a TOML file with tables `[[posts]]`, `[[walls]]` and `[[walkers]]`.

    Raises:
        InvalidValueError: for a source that is neither.
        SettingsFileError: for a file that can't be read or has invalid fields.
    """
    if source in NAMED_OBSTACLES:
        return NAMED_OBSTACLES[source]
    path = Path(source)
    if not source or (path.suffix.lower() != ".toml" and not os.path.exists(path)):
        raise InvalidValueError("obstacles", source, f"one of {', '.join(NAMED_OBSTACLES)}, or a .toml file")
    return build(Obstacles, read_toml(path), source)
