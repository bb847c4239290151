"""Controller gains from `trackslip tune`, by controller and compensation."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple, Self

from experiments.common.lookup import has_arguments
from trackslip.errors import InvalidValueError
from trackslip.files import read_json

GAINS_FILE: Final = "gains.json"
"""Name of the file with gains, in the results of `tune` and, for the shipped gains, beside this
module.
"""
ROUGHNESS_LIMIT: Final = 2.0
"""Roughness above which `tune` prefers smoother gains and the leaderboard marks an entry
[rad/s^2].
"""
TUNED: Final = "tuned"
"""Source name for the shipped gains of trackslip's controllers."""

Arguments = Mapping[tuple[str, str], Mapping[str, float]]
"""Constructor arguments by controller and compensation."""


class Choice(NamedTuple):
    """The gains chosen for a controller with a compensation."""

    gains: str
    """Source of the gains: "tuned", the path of a `tune` result, "given" (with the controller's
    name), or "default".
    """
    arguments: Mapping[str, float]


@dataclass(frozen=True)
class Gains:
    """Constructor arguments of tuned controllers; other controllers keep their classes'
    defaults.
    """

    tables: Mapping[str, Arguments] = field(default_factory=dict)
    """Tables by source; the first table that contains a controller is used."""

    @classmethod
    def load(cls, source: str) -> Self:
        """Load gains: "default" for the classes' defaults, "tuned" for the shipped gains, or a path
        of `tune` results.

        Controllers missing from a `tune` result get the shipped gains. Raises InvalidValueError for
        any other source.
        """
        if source == "default":
            return cls()
        shipped = {TUNED: _arguments(Path(__file__).parent)}
        try:
            return cls(shipped if source == TUNED else {source: _arguments(Path(source))} | shipped)
        except (OSError, ValueError, RecursionError, KeyError, TypeError, AttributeError):
            allowed = "tuned, default, or a folder or file that trackslip tune wrote"
            raise InvalidValueError("gains", source, allowed) from None

    def choice(self, controller: str, compensation: str) -> Choice:
        """The gains of a controller with a compensation.

        If the tables have none for this compensation, the gains for `online` are used if it learns
        online, otherwise those for `icr_radius`.
        """
        if has_arguments(controller):
            return Choice("given", {})
        similar = "online" if compensation.startswith("online") else "icr_radius"
        for source, arguments in self.tables.items():
            for law in (compensation, similar):
                if (controller, law) in arguments:
                    label = source if law == compensation else f"{source} for {law}"
                    return Choice(label, arguments[controller, law])
        return Choice("default", {})

    def specification(self, controller: str, compensation: str) -> str:
        """A controller's name with its tuned arguments, if there are any."""
        return specified(controller, self.choice(controller, compensation).arguments)


def _arguments(path: Path) -> Arguments:
    rows = read_json(path / GAINS_FILE if path.is_dir() else path)["gains"]
    return {
        (row["controller"], row["compensation"]): {
            name: float(value) for name, value in row["arguments"].items()
        }
        for row in rows
    }


def specified(controller: str, arguments: Mapping[str, float]) -> str:
    """A controller's name with constructor arguments, in the form that `lookup.controller`
    expects.
    """
    listed = ",".join(f"{name}={value!r}" for name, value in arguments.items())
    return f"{controller}:{listed}" if listed else controller
