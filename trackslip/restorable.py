"""Objects with a state that can be saved and restored exactly."""

from __future__ import annotations

import copy
from collections import deque
from collections.abc import Mapping
from typing import Any, ClassVar, Final

import numpy as np

_KIND: Final = "bit_generator"  # the entry of a random generator's state that names its kind


class Restorable:
    """An object whose state is in the attributes named by `STATE`.

    A state is data: arrays, numbers, texts and frozen dataclasses, in dictionaries, lists and
    tuples. It can be stored in any format, and names no code. Tuples hold only immutable objects.
    """

    STATE: ClassVar[tuple[str, ...]] = ()

    def get_state(self) -> dict[str, Any]:
        """Return a copy of the state, by attribute name."""
        return {name: _saved(getattr(self, name)) for name in self.STATE}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore a state of this object or of another object with the same constructor
        arguments.
        """
        for name in self.STATE:
            current = getattr(self, name)
            saved = state[name]
            if isinstance(current, Restorable):
                current.set_state(saved)
            elif isinstance(current, np.ndarray) and current.shape == np.shape(saved):
                current[...] = saved  # other objects may refer to the array
            else:
                setattr(self, name, _restored(current, saved))


def _saved(value: Any) -> Any:
    if isinstance(value, Restorable):
        return value.get_state()
    if isinstance(value, np.random.Generator):
        return copy.deepcopy(value.bit_generator.state)
    if isinstance(value, list | deque):
        return [_saved(item) for item in value]
    return value if isinstance(value, tuple) else copy.deepcopy(value)


def _restored(current: Any, saved: Any) -> Any:
    """What `saved` stands for, in the place of `current`."""
    if isinstance(saved, Mapping) and _KIND in saved:
        generator = np.random.default_rng()
        generator.bit_generator.state = saved
        return generator
    if isinstance(saved, list | tuple):
        items = [_restored(None, item) for item in saved]
        if isinstance(current, deque):
            return deque(items, current.maxlen)
        return tuple(items) if isinstance(current, tuple) else items
    return copy.deepcopy(saved)
