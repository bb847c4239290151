"""The base class for every command's options: bounds on options and exclusions between them, both
as data.
"""

import dataclasses
import functools
import typing
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, ClassVar

import tyro

from trackslip.errors import (
    InvalidValueError,
    require_at_most,
    require_non_negative,
    require_positive,
)


class Bound:
    """Allowed values for an option, as metadata of its type: `speed: Annotated[float, Within(0.1,
    2, "m/s")] = 0.3`.

    None, for an option that isn't given, is allowed. Each number in a tuple is checked.
    """

    def check(self, name: str, value: Any) -> None:
        """Raise InvalidValueError for a value that isn't allowed, naming option, value and what is
        allowed.
        """
        for number in value if isinstance(value, tuple) else (value,):
            if number is not None:
                self._check_number(name, number)

    def _check_number(self, name: str, number: Any) -> None:
        raise NotImplementedError


@dataclasses.dataclass(frozen=True)
class Within(Bound):
    """Numbers from `least` to `most`, in `unit`."""

    least: float
    most: float
    unit: str = ""

    def _check_number(self, name: str, number: float) -> None:
        if not self.least <= number <= self.most:
            raise InvalidValueError(
                name, number, f"from {self.least:g} to {self.most:g} {self.unit}".strip()
            )


@dataclasses.dataclass(frozen=True)
class NonNegative(Bound):
    """Finite numbers from 0 to `most`, in `unit`."""

    most: float = float("inf")
    unit: str = ""

    def _check_number(self, name: str, number: float) -> None:
        require_non_negative(name, number)
        require_at_most(name, number, self.most, self.unit)


class Positive(NonNegative):
    """Finite numbers greater than 0, up to `most`, in `unit`."""

    def _check_number(self, name: str, number: float) -> None:
        require_positive(name, number)
        require_at_most(name, number, self.most, self.unit)


@dataclasses.dataclass(frozen=True)
class Whole(Bound):
    """Integers from `least`, up to `most` if there is a limit."""

    least: int = 0
    most: int | None = None

    def _check_number(self, name: str, number: int) -> None:
        if number < self.least or (self.most is not None and number > self.most):
            limits = (
                f">= {self.least}" if self.most is None else f"from {self.least} to {self.most}"
            )
            raise InvalidValueError(name, number, f"an integer {limits}")


@dataclasses.dataclass(frozen=True)
class Distinct(Bound):
    """At least one `item`, with no duplicates."""

    item: str = "value"

    def check(self, name: str, value: Sequence[Any] | None) -> None:
        """Raise InvalidValueError for an empty sequence or duplicates; None is allowed."""
        if value is None:
            return
        if not value:
            raise InvalidValueError(name, value, f"at least one {self.item}")
        if len(set(value)) < len(value):
            raise InvalidValueError(name, value, "all different")


@dataclasses.dataclass(frozen=True)
class Exclusion:
    """Options `names` that have no effect for some values of another `option`, and then must keep
    their defaults. Dots lead to options in a group.

    The other option matches if it has one of `values` or, if there are no `values`, differs from
    its default.
    """

    names: tuple[str, ...]
    option: str
    values: tuple[Any, ...] = ()

    where: ClassVar[bool]
    """True if `names` have no effect when `option` matches, False if they have no effect when it
    doesn't match.
    """

    def applies(self, options: "Options") -> bool:
        """Whether `names` have no effect in these options."""
        value = getattr(options, self.option)
        if self.values:
            matches = value in self.values
        else:
            matches = value != defaults_of(options)[self.option]
        return bool(matches) == self.where

    def check(self, options: "Options") -> None:
        """Raise InvalidValueError for the first of `names` that is set but has no effect."""
        if not self.applies(options):
            return
        values = self.values
        if self.where and values:  # the value that it has, rather than all that it could have
            values = (getattr(options, self.option),)
        flags = [self._flag(value) for value in values or (None,)]
        reason = f"{'with' if self.where else 'without'} {' or '.join(flags)}"
        defaults = defaults_of(options)
        for name in self.names:
            group, *inner = name.split(".")
            default = functools.reduce(getattr, inner, defaults[group])
            refuse_changed(name, option(options, name), default, reason)

    def _flag(self, value: Any) -> str:
        flag = f"--{'no-' if value is False else ''}{self.option.replace('_', '-')}"
        return flag if value is None or isinstance(value, bool) else f"{flag} {value}"


class Excludes(Exclusion):
    """Options `names` that have no effect when `option` matches."""

    where = True


class Needs(Exclusion):
    """Options `names` that have no effect when `option` does not match."""

    where = False


@dataclasses.dataclass(frozen=True)
class Options:
    """Base class for a command's options, which checks bounds and exclusions.

    A subclass adds its own exclusions, and makes any other checks in `__post_init__`.
    """

    exclusions: ClassVar[tuple[Exclusion, ...]] = ()

    def __post_init__(self) -> None:
        for name, bound in bounds_of(type(self)):
            bound.check(name, getattr(self, name))
        for exclusion in exclusions_of(type(self)):
            exclusion.check(self)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ResultsOptions(Options):
    """Base class for the options of a command that writes results to a folder, `out`."""

    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = dataclasses.field(
        default=False, metadata={"stored_unless": False}
    )
    """Replace the results in the output folder."""

    @property
    def stores_results(self) -> bool:
        """Whether the command writes results, and doesn't only print."""
        return True

    @property
    def runs_anew(self) -> bool:
        """Whether the command runs even if results with these options are stored."""
        return self.overwrite


def bounds_of(options: type) -> Iterator[tuple[str, Bound]]:
    """The bounds on the options in a class, each with the option's name."""
    hints = typing.get_type_hints(options, include_extras=True)
    for field in dataclasses.fields(options):
        for bound in getattr(hints[field.name], "__metadata__", ()):
            if isinstance(bound, Bound):
                yield field.name, bound


def exclusions_of(options: type) -> Iterator[Exclusion]:
    """The exclusions in an options class and its bases."""
    for base in options.__mro__:
        yield from vars(base).get("exclusions", ())


def defaults_of(options: Options) -> dict[str, Any]:
    """Default values by option, for all options that have one."""
    missing = dataclasses.MISSING
    fields = dataclasses.fields(options)
    plain = {field.name: field.default for field in fields if field.default is not missing}
    return plain | {
        field.name: field.default_factory()
        for field in fields
        if field.default_factory is not missing
    }


def refuse_changed(name: str, value: Any, default: Any, reason: str) -> None:
    """Raise InvalidValueError if an option without effect, or one in a group of options, differs
    from its default.
    """
    if dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            inner = f"{name}.{field.name}".removesuffix(".source")
            refuse_changed(inner, getattr(value, field.name), getattr(default, field.name), reason)
    elif value != default:
        is_single = isinstance(value, tuple) and len(value) == 1
        raise InvalidValueError(name, value[0] if is_single else value, f"left out {reason}")


def option(config: Any, name: str) -> Any:
    """The value of the option `name`; dots lead to options in a group."""
    return functools.reduce(getattr, name.split("."), config)


def with_option(config: Any, name: str, value: object) -> Any:
    """`config` with another value for the option `name`; raises InvalidValueError for a value that
    isn't allowed.
    """
    head, _, rest = name.partition(".")
    if not rest:
        return dataclasses.replace(config, **{head: value})
    try:
        inner = with_option(getattr(config, head), rest, value)
    except InvalidValueError as error:
        raise InvalidValueError(f"{head}.{error.field}", error.value, error.allowed) from error
    return dataclasses.replace(config, **{head: inner})


def default_is(text: str, metavar: str) -> object:
    """Annotation for an option that is None by default, with the default and placeholder that
    `--help` shows.
    """
    return tyro.conf.arg(metavar=metavar, help_behavior_hint=f"(default: {text})")
