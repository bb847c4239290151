"""Errors that a user can fix: each message is one line and says what is allowed."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import field, fields
from numbers import Integral, Real
from pathlib import PurePath
from typing import Any

_LONG = 200  # most characters of a value that are shown


class TrackslipError(Exception):
    """Base class of all errors that trackslip raises deliberately; `message` is put on one line."""

    def __init__(self, message: str = "") -> None:
        super().__init__(" ".join(message.splitlines()))  # names in files may contain line breaks


class InvalidValueError(TrackslipError, ValueError):
    """A value that is not allowed.

    Args:
        field: name of the field or option.
        value: the value given.
        allowed: what is allowed, in words.
    """

    def __init__(self, field: str, value: object, allowed: str) -> None:
        plain = float(value) if isinstance(value, float) else str(value) if isinstance(value, PurePath) else value
        shown = repr(plain)  # the repr of NumPy's floats and of paths includes the type
        if len(shown) > _LONG:
            shown = f"{shown[: _LONG // 2]} ... {shown[-_LONG // 4 :]}"
        super().__init__(f"{field} = {' '.join(shown.split())}: must be {allowed}")
        self.field, self.value, self.allowed = field, value, allowed

    def __reduce__(self) -> tuple[type[InvalidValueError], tuple[str, object, str]]:
        return type(self), (self.field, self.value, self.allowed)  # so that other processes can raise it


class LogError(TrackslipError, ValueError):
    """A log that cannot be read or used; the message names the file, row and column where it can."""


class LogWarning(UserWarning):
    """Rows or runs of a log that were left out; the message names the file, and row and column where it can."""


class RobotWarning(UserWarning):
    """A robot whose results need caution: not verified to follow theory, or only part of its model used."""


class SettingsFileError(TrackslipError, ValueError):
    """A file of settings that cannot be read; the message names the file and the field."""


class ReferenceFileError(TrackslipError, ValueError):
    """A file of waypoints that cannot be read or driven; the message names the file, row and column."""


class OutputError(TrackslipError, OSError):
    """A result that cannot be written."""


class RunFailedError(TrackslipError):
    """A run that stopped before its end: a robot tipped over, or a controller failed."""

    def __init__(self, message: str) -> None:
        super().__init__(message)
        self.logs: list[Any] = []
        """RunLogs of the fleet until then, with the message as "failure" in the metadata; empty if under two rows."""


def require(allowed: object, field: str, value: object, what: str) -> None:
    """Raise InvalidValueError unless the value is allowed; `what` says in words what is allowed."""
    if not allowed:
        raise InvalidValueError(field, value, what)


def require_positive(field: str, value: float, most: float = float("inf"), unit: str = "") -> None:
    """Raise InvalidValueError unless `value` is finite, greater than zero and at most `most`."""
    require(_true(lambda: value > 0.0 and _finite(value)), field, value, "a finite number > 0")
    require_at_most(field, value, most, unit)


def require_non_negative(field: str, value: float, most: float = float("inf"), unit: str = "") -> None:
    """Raise InvalidValueError unless `value` is finite, at least zero and at most `most`."""
    require(_true(lambda: value >= 0.0 and _finite(value)), field, value, "a finite number >= 0")
    require_at_most(field, value, most, unit)


def require_at_most(field: str, value: float, limit: float, unit: str = "") -> None:
    """Raise InvalidValueError for a value above `limit`."""
    require(_true(lambda: value <= limit), field, value, f"at most {limit:g} {unit}".strip())


def require_within(field: str, value: float, low: float, high: float, unit: str = "") -> None:
    """Raise InvalidValueError unless `value` is from `low` to `high`."""
    require(_true(lambda: low <= value <= high), field, value, f"from {low:g} to {high:g} {unit}".strip())


def require_finite(field: str, value: float) -> None:
    """Raise InvalidValueError unless `value` is finite."""
    require(_true(lambda: _finite(value)), field, value, "a finite number")


def require_range(field: str, ends: Any, low: float, high: float) -> None:
    """Raise InvalidValueError unless `ends` are two ascending numbers from `low` to `high`."""
    numbers = _true(lambda: len(ends) == 2 and all(isinstance(end, Real) for end in ends))
    valid = numbers and low <= ends[0] <= ends[1] <= high
    require(valid, field, ends, f"two ascending numbers from {low:g} to {high:g}")


def require_whole(field: str, value: Any, low: int, high: float = float("inf")) -> None:
    """Raise InvalidValueError unless `value` is a whole number, Python's or NumPy's, from `low` to `high`."""
    whole = isinstance(value, Integral) and not isinstance(value, bool)
    allowed = f"from {low} to {high}" if high < float("inf") else f">= {low}"
    require(whole and low <= value <= high, field, value, f"a whole number {allowed}")


def checked(default: Any, require: Callable[..., None], *limits: Any, **metadata: Any) -> Any:
    """A field of a Checked dataclass, whose values pass `require(name, value, *limits)`."""
    return field(default=default, metadata={"check": (require, limits), **metadata})


class Checked:
    """Base class of dataclasses with `checked` fields; for more checks, override `__post_init__` and call this one."""

    def __post_init__(self) -> None:
        for each in fields(self):  # type: ignore[arg-type]
            require, limits = each.metadata.get("check", (None, ()))
            if require:
                require(each.name, getattr(self, each.name), *limits)


def _finite(value: Any) -> bool:
    """True for a finite number that isn't too large for a float."""
    large = isinstance(value, Integral) and abs(int(value)) > sys.float_info.max
    return bool(-float("inf") < value < float("inf")) and not large


def _true(comparison: Callable[[], object]) -> bool:
    """True if a comparison holds; False if text or several numbers are compared with a number."""
    try:
        return bool(comparison())
    except (TypeError, ValueError):
        return False


def counted(count: int, noun: str) -> str:
    """A count with its noun, for messages: 1 drive, 2 drives."""
    return f"{count:,} {noun if count == 1 else f'{noun}s'}"


def first_line(error: Exception) -> str:
    """The first line of an error message from another library."""
    return str(error).splitlines()[0] if str(error) else type(error).__name__
