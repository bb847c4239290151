"""Reading what JSON holds somewhere inside, whatever it is."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any


def entry(content: Any, *keys: str | int) -> Any:
    """What is stored under nested keys or places in lists; None where nothing is."""
    for key in keys:
        if isinstance(content, Mapping) and isinstance(key, str):
            content = content.get(key)
        elif isinstance(content, list | tuple) and isinstance(key, int) and key < len(content):
            content = content[key]
        else:
            return None
    return content


def number(content: Any, *keys: str | int) -> float | None:
    """The finite number stored under nested keys; None for anything else."""
    found = entry(content, *keys)
    if isinstance(found, bool) or not isinstance(found, int | float) or not math.isfinite(found):
        return None
    return float(found)


def text(content: Any, *keys: str | int) -> str:
    """The text stored under nested keys; empty for anything else."""
    found = entry(content, *keys)
    return found if isinstance(found, str) else ""


def texts(content: Any, *keys: str | int) -> list[str]:
    """The texts in the list stored under nested keys."""
    found = entry(content, *keys)
    return [one for one in found if isinstance(one, str)] if isinstance(found, list | tuple) else []
