"""Errors that a user can fix, with messages of one line that state what is allowed, and checks that
raise them.
"""

from __future__ import annotations

import difflib
import sys
from collections.abc import Callable, Collection, Iterable
from dataclasses import field, fields
from numbers import Integral, Real
from pathlib import PurePath
from typing import Any, Final

_MAX_SHOWN: Final = 200  # length above which a value is abbreviated in messages [characters]


class TrackslipError(Exception):
    """Base class of all errors that trackslip raises deliberately, with a message of one line."""

    def __init__(self, message: str = "") -> None:
        super().__init__(" ".join(message.splitlines()))  # names from files may contain line breaks


class InvalidValueError(TrackslipError, ValueError):
    """A value that is not allowed.

    Args:
        field: name of the field or option.
        value: the invalid value.
        allowed: description of the allowed values.
    """

    def __init__(self, field: str, value: object, allowed: str) -> None:
        plain: object = _plain(value)
        if type(value) is tuple:
            plain = tuple(map(_plain, value))
        shown = repr(plain)
        if len(shown) > _MAX_SHOWN:
            shown = f"{shown[: _MAX_SHOWN // 2]} ... {shown[-_MAX_SHOWN // 4 :]}"
        super().__init__(f"{field} = {' '.join(shown.split())}: must be {allowed}")
        self.field, self.value, self.allowed = field, value, allowed

    def __reduce__(self) -> tuple[type[InvalidValueError], tuple[str, object, str]]:
        return type(self), (self.field, self.value, self.allowed)  # picklable, for other processes


def _plain(value: object) -> object:
    """A value whose `repr` doesn't include its type, as that of NumPy floats and of paths does."""
    if isinstance(value, float):
        return float(value)
    return str(value) if isinstance(value, PurePath) else value


class LogError(TrackslipError, ValueError):
    """A log that cannot be read or used. The message names the file and, if possible, row and
    column.
    """


class LogWarning(UserWarning):
    """Omitted rows or runs of a log. The message names the file and, if possible, row and
    column.
    """


class RobotWarning(UserWarning):
    """A robot whose results need caution, because theory does not verify them or they use only part
    of its model.
    """


class SettingsFileError(TrackslipError, ValueError):
    """A settings file that cannot be read. The message names the file and the field."""


class ReferenceFileError(TrackslipError, ValueError):
    """A waypoint file that cannot be read or driven. The message names the file, row and column."""


class OutputError(TrackslipError, OSError):
    """An output file that cannot be written."""


class RunFailedError(TrackslipError):
    """A run that stopped before its end because a robot tipped over or a controller failed."""

    def __init__(self, message: str) -> None:
        super().__init__(message)
        self.logs: list[Any] = []
        """RunLogs of the fleet, with the message as "failure" in their metadata; empty for fewer
        than two rows.
        """


def require(allowed: object, field: str, value: object, what: str) -> None:
    """Raise InvalidValueError for `field` unless `allowed` is true; `what` describes the allowed
    values.
    """
    if not allowed:
        raise InvalidValueError(field, value, what)


def one_of(names: Iterable[str], given: object, others: str = "") -> str:
    """Description of the allowed `names`, and of `others` beside them, for an error: with the name
    that is most similar to what was `given`, if any is.
    """
    known = [str(name) for name in names]
    return f"one of {', '.join(known)}{others}{did_you_mean(given, known)}"


def did_you_mean(given: object, names: Iterable[str]) -> str:
    """The most similar of the names, as the end of a message; empty if none is similar."""
    known = {name.lower(): name for name in names}
    similar = difflib.get_close_matches(str(given).lower()[:_MAX_SHOWN], known, 1)
    return f" (did you mean {known[similar[0]]}?)" if similar else ""


def require_one_of(field: str, value: object, names: Collection[Any], others: str = "") -> None:
    """Raise InvalidValueError for a value that isn't one of `names`; `others` describes what else
    is allowed, and was checked before.
    """
    if value not in names:
        raise InvalidValueError(field, value, one_of(names, value, others))


def require_positive(field: str, value: float, most: float = float("inf"), unit: str = "") -> None:
    """Raise InvalidValueError unless `value` is finite, greater than zero and at most `most`."""
    require(_true(lambda: value > 0.0 and _finite(value)), field, value, "a finite number > 0")
    require_at_most(field, value, most, unit)


def require_non_negative(
    field: str, value: float, most: float = float("inf"), unit: str = ""
) -> None:
    """Raise InvalidValueError unless `value` is finite, at least zero and at most `most`."""
    require(_true(lambda: value >= 0.0 and _finite(value)), field, value, "a finite number >= 0")
    require_at_most(field, value, most, unit)


def require_at_most(field: str, value: float, limit: float, unit: str = "") -> None:
    """Raise InvalidValueError for a value above `limit`."""
    require(_true(lambda: value <= limit), field, value, f"at most {limit:g} {unit}".strip())


def require_within(field: str, value: float, low: float, high: float, unit: str = "") -> None:
    """Raise InvalidValueError unless `value` is from `low` to `high`."""
    require(
        _true(lambda: low <= value <= high),
        field,
        value,
        f"from {low:g} to {high:g} {unit}".strip(),
    )


def require_finite(field: str, value: float) -> None:
    """Raise InvalidValueError unless `value` is finite."""
    require(_true(lambda: _finite(value)), field, value, "a finite number")


def require_range(field: str, ends: Any, low: float, high: float) -> None:
    """Raise InvalidValueError unless `ends` are two ascending numbers from `low` to `high`."""
    numbers = _true(lambda: len(ends) == 2 and all(isinstance(end, Real) for end in ends))
    valid = numbers and low <= ends[0] <= ends[1] <= high
    require(valid, field, ends, f"two ascending numbers from {low:g} to {high:g}")


def require_whole(field: str, value: Any, low: int, high: float = float("inf")) -> None:
    """Raise InvalidValueError unless `value` is a whole number, Python's or NumPy's, from `low` to
    `high`.
    """
    is_whole = isinstance(value, Integral) and not isinstance(value, bool)
    allowed = f"from {low} to {high}" if high < float("inf") else f">= {low}"
    require(is_whole and low <= value <= high, field, value, f"a whole number {allowed}")


def checked(default: Any, require: Callable[..., None], *limits: Any, **metadata: Any) -> Any:
    """Return a field of a Checked dataclass, whose values are checked with `require(name, value,
    *limits)`.
    """
    return field(default=default, metadata={"check": (require, limits), **metadata})


class Checked:
    """Base class of dataclasses with `checked` fields. For more checks, extend `__post_init__`."""

    def __post_init__(self) -> None:
        for each in fields(self):  # type: ignore[arg-type]
            require, limits = each.metadata.get("check", (None, ()))
            if require:
                require(each.name, getattr(self, each.name), *limits)


def _finite(value: Any) -> bool:
    """Whether a value is a finite number that isn't too large for a float."""
    large = isinstance(value, Integral) and abs(int(value)) > sys.float_info.max
    return bool(-float("inf") < value < float("inf")) and not large


def _true(comparison: Callable[[], object]) -> bool:
    """Whether a comparison is true; False if text or several numbers are compared with a number."""
    try:
        return bool(comparison())
    except (TypeError, ValueError):
        return False


def counted(count: int, noun: str) -> str:
    """Format a count with its noun for messages: 1 drive, 2 drives."""
    return f"{count:,} {noun if count == 1 else f'{noun}s'}"


def first_line(error: Exception) -> str:
    """The first line of an error message from another library."""
    return str(error).splitlines()[0] if str(error) else type(error).__name__
