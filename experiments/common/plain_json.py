"""JSON from dataclasses, arrays and paths."""

import dataclasses
import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

_AS_IT_IS: Final = (str, int, bool, type(None))


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON, with NaN as null and NumPy numbers as plain numbers."""
    path.write_text(json.dumps(plain(content), indent=2, allow_nan=False) + "\n", encoding="utf-8")


def plain(value: Any) -> Any:
    """`value` in JSON's types: dataclasses become mappings, and numbers that aren't finite become
    None.

    A dataclass field is left out if its value equals `stored_unless` in the field's metadata.
    """
    if type(value) in _AS_IT_IS:
        return value
    if type(value) is float:
        return value if math.isfinite(value) else None
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(item) for f, item in _stored(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    return str(value) if isinstance(value, Path) else value


def _stored(value: Any) -> Iterator[tuple[dataclasses.Field[Any], Any]]:
    """The fields of a dataclass that JSON stores, and their values."""
    for f in dataclasses.fields(value):
        item = getattr(value, f.name)
        # arrays compare element by element, so only fields that ask for it are compared
        if "stored_unless" not in f.metadata or f.metadata["stored_unless"] != item:
            yield f, item
