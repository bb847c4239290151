"""Gains of controllers that `trackslip tune` found, by controller and compensation."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from experiments.common.manifest import relative
from trackslip.errors import InvalidValueError

GAINS_FILE = "gains.json"
"""Name of the file in a folder of results."""
SHIPPED = Path(__file__).with_name(GAINS_FILE)
"""Gains of trackslip's controllers."""


@dataclass(frozen=True)
class Gains:
    """Constructor arguments of controllers that were tuned; those of the others are their classes' defaults."""

    found: Mapping[str, Mapping[str, Mapping[str, float]]] = field(default_factory=dict)
    """Arguments by controller and compensation."""

    @classmethod
    def load(cls, source: str) -> Self:
        """Gains by name: "default" for those of the classes, "tuned" for the shipped ones, or a result of `tune`.

        Raises InvalidValueError for any other source.
        """
        if source == "default":
            return cls()
        path = SHIPPED if source == "tuned" else Path(source)
        try:
            rows = json.loads((path / GAINS_FILE if path.is_dir() else path).read_text(encoding="utf-8"))["gains"]
            found: dict[str, dict[str, dict[str, float]]] = {}
            for row in rows:
                arguments = {str(name): float(value) for name, value in row["arguments"].items()}
                found.setdefault(row["controller"], {})[row["compensation"]] = arguments
        except (OSError, ValueError, RecursionError, KeyError, TypeError, AttributeError):
            allowed = "tuned, default, or a folder or file that trackslip tune wrote"
            raise InvalidValueError("gains", relative(source), allowed) from None
        return cls(found)

    def specification(self, controller: str, compensation: str) -> str:
        """A controller's name with its tuned arguments; unchanged if there are none.

        A compensation that was not tuned for takes the gains of the like one: `online` for those that learn, else
        `icr_radius`.
        """
        like = "online" if compensation.startswith("online") else "icr_radius"
        by_law = self.found.get(controller, {})
        arguments = by_law.get(compensation, by_law.get(like, {}))
        return specified(controller, arguments)


def specified(controller: str, arguments: Mapping[str, Any]) -> str:
    """A controller with constructor arguments, as `lookup.controller` takes it."""
    return controller + ":" * bool(arguments) + ",".join(f"{name}={value!r}" for name, value in arguments.items())
