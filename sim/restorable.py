"""Objects with a state that can be saved and restored exactly."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np


class Restorable:
    """An object whose state is in the attributes named by `STATE`. Tuples in the state hold only
    immutable objects.
    """

    STATE: ClassVar[tuple[str, ...]] = ()

    def get_state(self) -> dict[str, Any]:
        """Return a copy of the state, by attribute name, which can be pickled."""
        return {name: _saved(getattr(self, name)) for name in self.STATE}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore a state of this object or of another object with the same constructor
        arguments.
        """
        for name in self.STATE:
            own, saved = getattr(self, name), state[name]
            if isinstance(own, Restorable):
                own.set_state(saved)
            elif isinstance(own, np.ndarray) and own.shape == np.shape(saved):
                own[...] = saved  # other objects may refer to the array
            else:
                setattr(self, name, _saved(saved))


def _saved(value: Any) -> Any:
    if isinstance(value, Restorable):
        return value.get_state()
    return value if isinstance(value, tuple) else copy.deepcopy(value)
