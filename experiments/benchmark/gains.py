"""Gains of controllers that `trackslip tune` found, by controller and compensation."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from trackslip.errors import InvalidValueError

GAINS_FILE = "gains.json"
"""Of a folder of results, and of trackslip's controllers beside this module."""


@dataclass(frozen=True)
class Gains:
    """Constructor arguments of controllers that were tuned; those of the others are their classes' defaults."""

    arguments: Mapping[tuple[str, str], Mapping[str, float]] = field(default_factory=dict)
    """Arguments by controller and compensation."""

    @classmethod
    def load(cls, source: str) -> Self:
        """Gains by name: "default" for those of the classes, "tuned" for the shipped ones, or a result of `tune`.

        Raises InvalidValueError for any other source.
        """
        if source == "default":
            return cls()
        path = Path(__file__).parent if source == "tuned" else Path(source)
        try:
            rows = json.loads((path / GAINS_FILE if path.is_dir() else path).read_text(encoding="utf-8"))["gains"]
            gains = {(row["controller"], row["compensation"]): row["arguments"] for row in rows}
            return cls({pair: {name: float(value) for name, value in row.items()} for pair, row in gains.items()})
        except (OSError, ValueError, RecursionError, KeyError, TypeError, AttributeError):
            allowed = "tuned, default, or a folder or file that trackslip tune wrote"
            raise InvalidValueError("gains", source, allowed) from None

    def specification(self, controller: str, compensation: str) -> str:
        """A controller's name with its tuned arguments; unchanged if there are none.

        A compensation that was not tuned for takes the gains of a similar one: `online` for those that learn, else
        `icr_radius`.
        """
        similar = "online" if compensation.startswith("online") else "icr_radius"
        fallback = self.arguments.get((controller, similar), {})
        return specified(controller, self.arguments.get((controller, compensation), fallback))


def specified(controller: str, arguments: Mapping[str, float]) -> str:
    """A controller with constructor arguments, as `lookup.controller` takes it."""
    listed = ",".join(f"{name}={value!r}" for name, value in arguments.items())
    return f"{controller}:{listed}" if listed else controller
