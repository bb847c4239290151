"""The format version of stored results, so that files from a newer trackslip are refused instead of misread."""

from __future__ import annotations

import importlib.metadata
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from trackslip.errors import LogError

FORMAT = 1
"""Format of the manifests, laws and runs written by this version; it increases when older versions cannot read them."""
MANIFEST = "manifest.json"


def require_known_format(content: Mapping[str, Any], source: object) -> None:
    """Raise LogError if `content`, called `source` in the message, is from a newer version.

    Without `format`, it is of the first one. A manifest has `versions`, which name the version that wrote it.
    """
    found = content.get("format", 1)
    if isinstance(found, bool) or not isinstance(found, int) or found < 1:
        raise LogError(f"{source}: format = {found!r}: must be an integer >= 1")
    if found > FORMAT:
        versions = content.get("versions")
        writer = versions.get("trackslip") if isinstance(versions, Mapping) else None
        by = f"trackslip {writer}" if writer else "a newer trackslip"
        try:
            this = f"trackslip {importlib.metadata.version('trackslip')}"
        except importlib.metadata.PackageNotFoundError:
            this = "this trackslip"
        raise LogError(f"{source}: written by {by} in format {found}; {this} reads formats up to {FORMAT}")


def require_known_manifest(folder: Path) -> None:
    """Raise LogError if the manifest of a folder of results is damaged or from a newer version."""
    file = folder / MANIFEST
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:  # the log of a real robot
        return
    except OSError as error:
        raise LogError(f"{file}: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise LogError(f"{file}: not JSON ({error})") from error
    if not isinstance(content, Mapping):
        raise LogError(f"{file}: not a manifest")
    require_known_format(content, file)
