"""File names for runs."""

import itertools
import re
from collections.abc import Sequence

_MAX_NAME = 120  # characters


def file_names(names: Sequence[str], ending: str = "") -> list[str]:
    """File names (n,) with an ending for runs, all different whatever the runs are called."""
    found: list[str] = []
    for name in names:
        plain = re.sub(r"[^\w.=+-]+", "_", name).strip("._")[:_MAX_NAME] or "run"
        taken = {other.lower() for other in found}
        candidates = (f"{plain}{ending}" if k == 1 else f"{plain}_{k}{ending}" for k in itertools.count(1))
        found.append(next(file for file in candidates if file.lower() not in taken))
    return found
