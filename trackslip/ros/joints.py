"""Which joints drive the left and the right side, by their names."""

from __future__ import annotations

import re
from collections.abc import Sequence

from trackslip.errors import LogError

_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_DRIVES = re.compile(r"wheel|track|sprocket|belt|crawler|whl", re.IGNORECASE)
_OTHERS = {"arm", "hip", "pan", "tilt", "head", "neck", "knee", "ankle", "calf"}
_OTHERS_BEGIN = ("steer", "caster", "castor", "flipper", "finger", "gripper", "shoulder", "elbow", "wrist", "thigh")
_LEFT = {"left", "l", "fl", "lf", "rl", "lr", "bl", "lb", "ml", "lm", "cl", "lc", "lh", "lhs"}
_RIGHT = {"right", "r", "fr", "rf", "rr", "br", "rb", "mr", "rm", "cr", "rc", "rh", "rhs"}
_SHOWN = 12  # joints in a message


def sides(names: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]] | None:
    """Names of the driven joints on the left and on the right; None if the names don't tell.

    Joints whose names speak of wheels or tracks come before others, and arms, steering and the like don't count.
    """
    candidates = [name for name in names if not _other(_words(name))]
    driven = [name for name in candidates if _DRIVES.search(name)]
    for some in (driven, candidates):
        left = tuple(name for name in some if _side(name) == "left")
        right = tuple(name for name in some if _side(name) == "right")
        if left and len(left) == len(right):
            return left, right
    return None


def known_joints(chosen: Sequence[str], names: Sequence[str], side: str, topic: str) -> None:
    """Raise LogError if joints were chosen that the topic hasn't."""
    for name in chosen:
        if name not in names:
            raise LogError(f"{side} = {name!r}: topic {topic} has no such joint; its joints are {listed(names)}")


def listed(names: Sequence[str]) -> str:
    """Names of joints for a message."""
    return ", ".join(names[:_SHOWN] or ["none"]) + (f", ... ({len(names)} of them)" if len(names) > _SHOWN else "")


def _side(name: str) -> str:
    """left, right, or nothing if the name tells neither, or both."""
    words, plain = _words(name), name.lower()
    left = bool(words & _LEFT) or "left" in plain
    right = bool(words & _RIGHT) or "right" in plain
    return "" if left == right else "left" if left else "right"


def _words(name: str) -> set[str]:
    """The words in a name, in lower case: of front_leftWheel2 front, left and wheel."""
    return {word.lower() for word in _WORDS.findall(name)}


def _other(words: set[str]) -> bool:
    """Whether words speak of a joint that drives neither side."""
    return bool(words & _OTHERS) or any(word.startswith(_OTHERS_BEGIN) for word in words)
