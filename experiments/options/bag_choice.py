"""The options that say what to take from a bag, shared by every command that reads one."""

from dataclasses import dataclass
from typing import Annotated, Literal

import tyro

from experiments.options.help import default_is
from trackslip.errors import InvalidValueError
from trackslip.ros.choice import BagChoice

_CLEAR = "where the bag leaves no doubt"


@dataclass(frozen=True)
class BagOptions:
    """What to take from a bag."""

    encoders: Annotated[str | None, default_is(_CLEAR, "TOPIC")] = None
    """Topic of sensor_msgs/JointState with the wheels or sprockets."""
    left: Annotated[str | None, default_is("by their names", "NAMES")] = None
    """Names of the joints on the left, separated by commas; their mean is used."""
    right: Annotated[str | None, default_is("by their names", "NAMES")] = None
    """The same on the right."""
    reversed: Annotated[Literal["left", "right", "both"] | None, default_is("none", "{left,right,both}")] = None
    """Which encoders count backwards."""
    poses: Annotated[str | None, default_is(_CLEAR, "TOPIC")] = None
    """Topic of the poses, or tf:PARENT:CHILD for the pose of a frame, as in tf:map:base_link."""

    def __post_init__(self) -> None:
        self.choice()

    def choice(self) -> BagChoice:
        """The same for the readers of bags."""
        return BagChoice(
            self.encoders, _names("left", self.left), _names("right", self.right), self.reversed, self.poses
        )


Bag = Annotated[BagOptions, tyro.conf.arg(name="")]
"""BagOptions without a prefix on the command line."""


def _names(option: str, given: str | None) -> tuple[str, ...] | None:
    """The names in a list separated by commas."""
    if given is None:
        return None
    names = tuple(name.strip() for name in given.split(","))
    if not all(names):
        raise InvalidValueError(option, given, "names of joints, separated by commas")
    return names
