"""Large results of other processes, through files: a pipe has them copied several times in small pieces."""

import contextlib
import mmap
import os
import pickle
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any

_LARGE = 1_000_000  # results from this size on go through a file [bytes]
_ALIGNED = 64  # arrays begin at multiples of this [bytes]


@dataclass(frozen=True)
class Filed:
    """A result in a file: its pickle, then the memory of its arrays."""

    file: str
    sizes: tuple[int, ...]
    """Of the parts [bytes]."""

    def read(self) -> Any:
        """The result, whose arrays are the file's pages; deletes the file."""
        path = Path(self.file)
        with path.open("rb") as file:
            pages = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY))
        with contextlib.suppress(OSError):  # not every system deletes a file that is mapped
            path.unlink()
        parts = [pages[at : at + size] for at, size in zip(_places(self.sizes), self.sizes, strict=True)]
        return pickle.loads(parts[0], buffers=parts[1:])


def filed(prefix: str, do: Callable[[], Any]) -> Any:
    """What a call returns; if that is large and there is room for a file whose path begins with `prefix`, a Filed."""
    result = do()
    buffers: list[pickle.PickleBuffer] = []
    parts = [memoryview(pickle.dumps(result, 5, buffer_callback=buffers.append)), *(one.raw() for one in buffers)]
    sizes = tuple(len(part) for part in parts)
    if sum(sizes) < _LARGE:
        return result
    folder, name = os.path.split(prefix)
    path = ""
    try:
        with tempfile.NamedTemporaryFile(dir=folder, prefix=name, delete=False) as file:
            path = file.name
            for place, part in zip(_places(sizes), parts, strict=True):
                file.seek(place)
                file.write(part)
    except OSError:
        with contextlib.suppress(OSError):  # of what could be written
            os.unlink(path)
        return result
    return Filed(path, sizes)


def _places(sizes: tuple[int, ...]) -> list[int]:
    """Where parts begin, one after another [bytes]."""
    return list(accumulate((-(-size // _ALIGNED) * _ALIGNED for size in sizes[:-1]), initial=0))
