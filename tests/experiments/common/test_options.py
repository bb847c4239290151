"""Every option of every command: its bounds and exclusions are kept.

The cases are generated from the options' fields: a new command or option is tested without a line here.
"""

import dataclasses
import shlex
import typing
from functools import cache
from pathlib import Path

import pytest

from experiments.cli import commands, config_module, parse
from experiments.common.options import (
    Distinct,
    Excludes,
    NonNegative,
    Options,
    Positive,
    Whole,
    Within,
    bounds_of,
    exclusions_of,
)
from trackslip.errors import InvalidValueError

CONFIGS = {name: config_module(name).Config for name in commands()}
WITH_BOUNDS = {name: config for name, config in CONFIGS.items() if issubclass(config, Options)}
BOUNDED = [(name, *bound) for name, config in WITH_BOUNDS.items() for bound in bounds_of(config)]
EXCLUDED = [
    (name, exclusion, option)
    for name, config in WITH_BOUNDS.items()
    for exclusion in exclusions_of(config)
    for option in exclusion.names
]


@cache
def example(name):
    """The options of a command's first example."""
    return parse(shlex.split(config_module(name).EXAMPLES[0][1])[1:])


def outside(bound):
    """Values that a bound refuses."""
    match bound:
        case Within():
            return bound.least - 1, bound.most + 1, float("nan")
        case Positive():
            return 0.0, -1.0, float("nan"), float("inf")
        case NonNegative():
            return -1.0, float("nan"), float("inf")
        case Whole():
            return (bound.least - 1, *(() if bound.most is None else (bound.most + 1,)))
        case Distinct():
            return (), ("a", "a")
    raise NotImplementedError(bound)


@pytest.mark.parametrize(("name", "option", "bound"), BOUNDED)
def test_a_value_out_of_bounds_is_refused(name, option, bound):
    config = example(name)
    usual, listed = getattr(config, option), (option, Distinct) in {(n, type(b)) for n, b in bounds_of(CONFIGS[name])}
    tuples = (isinstance(usual, tuple) or listed) and not isinstance(bound, Distinct)
    for value in outside(bound):
        given = (*(usual or ())[:-1], value) if tuples else value
        with pytest.raises(InvalidValueError, match=f"{option} = ") as refusal:
            dataclasses.replace(config, **{option: given})
        assert refusal.value.field == option


def another(default, hint, unlike=()):
    """A value other than an option's default, and none of those in `unlike`."""
    if isinstance(default, bool):
        return not default
    if isinstance(default, int | float):
        return type(default)(default + 1)
    if isinstance(default, tuple):
        return default[:-1]
    choices = typing.get_args(hint)
    if float in choices:
        return 0.01
    if int in choices:
        return 2
    if tuple[int, ...] in choices:
        return (2,)
    if typing.get_origin(hint) is typing.Literal:
        return next(choice for choice in choices if choice not in (default, *unlike))
    return Path("x") if Path in (hint, *choices) else "x"


@pytest.mark.parametrize(("name", "exclusion", "option"), EXCLUDED)
def test_an_option_without_effect_is_refused(name, exclusion, option):
    """A bound or another exclusion may refuse the combination first."""
    config = CONFIGS[name]
    base = example(name)
    hints = typing.get_type_hints(config)
    given = {option: another(getattr(base, option), hints[option])}
    if not exclusion.applies(base):
        if exclusion.values and isinstance(exclusion, Excludes):
            other = exclusion.values[0]
        else:
            other = another(getattr(base, exclusion.option), hints[exclusion.option], exclusion.values)
        given[exclusion.option] = other
    with pytest.raises(InvalidValueError) as refusal:
        dataclasses.replace(base, **given)
    assert "left out" in refusal.value.allowed or refusal.value.field == option
