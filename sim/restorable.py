"""Objects whose state can be saved and restored to the bit."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np


class Restorable:
    """An object with a state: the attributes that `STATE` names. Tuples among them hold what never changes."""

    STATE: ClassVar[tuple[str, ...]] = ()

    def get_state(self) -> dict[str, Any]:
        """A copy of the state, by name; it can be pickled."""
        return {name: _saved(getattr(self, name)) for name in self.STATE}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a state of this object, or of another that was made with the same arguments."""
        for name in self.STATE:
            own, saved = getattr(self, name), state[name]
            if isinstance(own, Restorable):
                own.set_state(saved)
            elif isinstance(own, np.ndarray) and own.shape == np.shape(saved):
                own[...] = saved  # others may look at the same array
            else:
                setattr(self, name, _saved(saved))


def _saved(value: Any) -> Any:
    if isinstance(value, Restorable):
        return value.get_state()
    return value if isinstance(value, tuple) else copy.deepcopy(value)
