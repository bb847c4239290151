"""Files of arrays with a JSON text about them (.npz), which name no code: neither pickle nor
imports are needed to read them.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trackslip.errors import LogError
from trackslip.files import MOST_ARRAYS, read_npz, reason
from trackslip.memory import half_of_memory

Arrays = dict[str, NDArray[Any]]

ABOUT: Final = "about"
"""Name of the JSON text among the arrays."""
# the only key of a table that stands for an array, by name
_ARRAY: Final = "array"


def write_arrays(path: Path, about: Any, arrays: Arrays) -> None:
    """Write arrays by name, and what JSON can store `about` them."""
    text = np.array(json.dumps(about))
    with path.open("wb") as file:
        np.savez(file, allow_pickle=False, **{ABOUT: text}, **arrays)


def read_arrays(file: Path, what: str, most: int = MOST_ARRAYS) -> tuple[dict[str, Any], Arrays]:
    """The table `about` and the arrays in a file; raises LogError if it can't be read, takes more
    than `most` bytes of memory, or isn't `what`.
    """
    try:
        arrays = read_npz(file, most)
        about = json.loads(str(arrays.pop(ABOUT)))
    except LogError:  # it takes too much memory
        raise
    except OSError as error:
        raise LogError(f"{file}: {error.strerror or error}") from error
    except Exception as error:  # any error of NumPy, zipfile and json for a damaged file
        raise LogError(f"{file}: not {what}") from error
    if not isinstance(about, dict):
        raise LogError(f"{file}: not {what}")
    return about, arrays


def write_nested(path: Path, content: Mapping[str, Any]) -> None:
    """Write nested tables and lists of arrays, numbers, texts and dataclasses, which become tables
    of their fields.
    """
    arrays: Arrays = {}
    write_arrays(path, _plain(content, "", arrays), arrays)


def read_nested(file: Path, what: str) -> dict[str, Any]:
    """The content of a file from `write_nested`, which may take half of the machine's memory;
    raises LogError as `read_arrays` does.
    """
    about, arrays = read_arrays(file, what, half_of_memory())
    try:
        content: dict[str, Any] = _with_arrays(about, arrays)
    except (KeyError, RecursionError) as error:
        raise LogError(f"{file}: not {what} ({reason(error)})") from error
    return content


def _plain(value: Any, name: str, arrays: Arrays) -> Any:
    """`value` as JSON stores it; arrays are added to `arrays`, by the path `name` that leads to
    them.
    """
    if isinstance(value, np.ndarray):
        arrays[name] = value
        return {_ARRAY: name}
    if isinstance(value, np.generic):
        return value.item()
    if dataclasses.is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): _plain(item, f"{name}/{key}", arrays) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item, f"{name}/{k}", arrays) for k, item in enumerate(value)]
    return value


def _with_arrays(content: Any, arrays: Arrays) -> Any:
    """The value from which `_plain` made `content`, with the arrays in their places."""
    if isinstance(content, list):
        return [_with_arrays(item, arrays) for item in content]
    if not isinstance(content, dict):
        return content
    if content.keys() == {_ARRAY}:
        return arrays[content[_ARRAY]]
    return {key: _with_arrays(item, arrays) for key, item in content.items()}
