"""The version number of stored results: what a newer trackslip wrote is refused, not misread."""

from __future__ import annotations

import importlib.metadata
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from trackslip.errors import LogError

FORMAT = 1
"""Of manifests, laws and runs, as this version writes them; it goes up when older versions can't read them."""
MANIFEST = "manifest.json"


def require_known_format(content: Mapping[str, Any], source: object) -> None:
    """Raise LogError for what says that a newer version wrote it; what says nothing is of the first format.

    Args:
        content: has `format`, and where it is a manifest `versions`.
        source: named in the message.
    """
    found = content.get("format", 1)
    if isinstance(found, bool) or not isinstance(found, int) or found < 1:
        raise LogError(f"{source}: format = {found!r}: must be an integer >= 1")
    if found > FORMAT:
        versions = content.get("versions")
        writer = versions.get("trackslip") if isinstance(versions, Mapping) else None
        by = f"trackslip {writer}" if writer else "a newer trackslip"
        raise LogError(f"{source}: written by {by} in format {found}; {_this()} reads formats up to {FORMAT}")


def require_known_manifest(folder: Path) -> None:
    """Raise LogError for a folder of results whose manifest is damaged, or a newer version's."""
    file = folder / MANIFEST
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:  # a real robot's log
        return
    except OSError as error:
        raise LogError(f"{file}: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise LogError(f"{file}: not JSON ({error})") from error
    if not isinstance(content, Mapping):
        raise LogError(f"{file}: not a manifest")
    require_known_format(content, file)


def _this() -> str:
    try:
        return f"trackslip {importlib.metadata.version('trackslip')}"
    except importlib.metadata.PackageNotFoundError:
        return "this trackslip"
