"""Counters in messages of any type: numbers in a topic that look like the ticks of an encoder."""

from __future__ import annotations

import dataclasses
import re
import shlex
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np

from trackslip.bags.open import Bag, Topic, listed
from trackslip.errors import LogError
from trackslip.kinematics import Array

_WHOLE_NUMBERS: Final = re.compile(r"std_msgs/msg/U?Int\d+(MultiArray)?")
_KNOWN: Final = (
    *("sensor_msgs/", "geometry_msgs/", "nav_msgs/", "tf2_msgs/", "tf/", "map_msgs/"),
    *("rosgraph_msgs/", "rcl_interfaces/", "diagnostic_msgs/", "visualization_msgs/"),
    *("action_msgs/", "bond/", "dynamic_reconfigure/", "lifecycle_msgs/", "shape_msgs/"),
)
"""Packages of messages without counters."""
_NOT_COUNTERS: Final = ("header", "stamp", "layout")  # fields of messages
_MESSAGES: Final = 500  # number of messages of a topic that are searched, from the start
_MOST_NUMBERS: Final = 64  # largest number of numbers in an array that are searched
_DEPTH: Final = 4  # number of levels of messages in messages that are searched
_FEWEST: Final = 10  # least number of different values of a counter
_SMOOTH: Final = 0.1  # ratio of a usual step to the range below which numbers look counted [-]


def numbers_in(topic: str, content: Any) -> dict[str, float]:
    """The numbers in a message by name: the topic and the path to the field, as in /ticks.left or
    /ticks[0]; a field `data` has the name of its topic.
    """
    return dict(_numbers(topic, content, _DEPTH))


def _numbers(name: str, value: Any, depth: int) -> Iterator[tuple[str, float]]:
    """Names and numbers of a field called `name`, and of the fields in it."""
    if isinstance(value, bool):
        return
    if isinstance(value, int | float | np.integer | np.floating):
        yield name, float(value)
    elif isinstance(value, np.ndarray | list):
        for k, item in enumerate(value[:_MOST_NUMBERS]):
            yield from _numbers(f"{name}[{k}]", item, depth - 1)
    elif dataclasses.is_dataclass(value) and depth > 0:
        for field in dataclasses.fields(value):
            if field.name not in _NOT_COUNTERS:
                path = name if field.name == "data" else f"{name}.{field.name}"
                yield from _numbers(path, getattr(value, field.name), depth - 1)


def counter_names(bag: Bag, topics: Sequence[Topic]) -> list[str]:
    """Names of the numbers in topics' first messages; raises LogError if there are none."""
    names = dict[str, None]()
    for topic in topics:
        for message in bag.first(topic.name, 1):
            names |= dict.fromkeys(numbers_in(topic.name, message.content))
    if not names:
        raise LogError(
            f"{bag.path}: topic {topics[0].name} has messages of {topics[0].type}, needs "
            "sensor_msgs/msg/JointState, nav_msgs/msg/Odometry or messages with numbers"
        )
    return [*names]


def full_names(chosen: Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
    """The full names of numbers that are chosen by their full name or by its end, as left for
    /ticks.left; a name that is unknown or ambiguous is unchanged.
    """
    full = []
    for name in chosen:
        ends = [each for each in names if each.endswith((f".{name}", f"/{name}"))]
        full.append(ends[0] if name not in names and len(ends) == 1 else name)
    return tuple(full)


def likely_counters(bag: Bag) -> dict[str, str]:
    """Names of the numbers in a bag that look like ticks, with the types of their messages; or else
    of all whole numbers in messages of `std_msgs`.
    """
    found = dict[str, str]()
    whole_numbers = dict[str, str]()
    for topic in bag.topics.values():
        if topic.type.startswith(_KNOWN):
            continue
        try:
            messages = bag.first(topic.name, _MESSAGES)
        except LogError:  # damaged, or of an unknown type
            continue
        values = dict[str, list[float]]()
        for message in messages:
            for name, value in numbers_in(topic.name, message.content).items():
                values.setdefault(name, []).append(value)
        for name, series in values.items():
            if _looks_counted(np.array(series)):
                found[name] = topic.type
            elif _WHOLE_NUMBERS.fullmatch(topic.type):
                whole_numbers[name] = topic.type
    return found or whole_numbers


def _looks_counted(values: Array) -> bool:
    """True if numbers (n,) in succession are whole and change in steps that are small for their
    range, as ticks do.
    """
    if len(values) < _FEWEST or not np.isfinite(values).all():
        return False
    step = np.abs(np.diff(values))
    moving = step[step > 0]
    is_whole = (values == np.round(values)).all()
    if not is_whole or len(np.unique(values)) < _FEWEST:
        return False
    return bool(np.median(moving) <= _SMOOTH * np.ptp(values))


def advice(counters: dict[str, str], sides: tuple[tuple[str, ...], tuple[str, ...]] | None) -> str:
    """The option that reads counters (with their types), for an error message; `sides` are the
    names of the left and right ones, if these are known.
    """
    shown = listed([f"{name} ({kind})" for name, kind in counters.items()])
    names = [*sides[0], *sides[1]] if sides else [*counters]
    topics = dict.fromkeys(name.partition(".")[0].partition("[")[0] for name in names)
    choice = f"--encoders {shlex.quote(','.join(topics))} --ticks-per-turn N"
    if sides is None:
        choice += " --left NAMES --right NAMES"
    return f"; {shown} may count ticks: {choice} reads them"
