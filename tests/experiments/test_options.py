"""Every option of every command: its bounds and exclusions are kept, and something uses it.

The cases are generated from the options' fields: a new command or option is tested without a line here.
"""

import ast
import dataclasses
import functools
import shlex
import typing
from pathlib import Path

import docstring_parser
import pytest

import experiments
import sim
import trackslip
from experiments.cli import command_modules, parse
from experiments.options.base import (
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

CONFIGS = {name: module.Config for name, module in command_modules().items()}
BOUNDED = [
    (name, *bound) for name, config in CONFIGS.items() if issubclass(config, Options) for bound in bounds_of(config)
]
EXCLUDED = [
    (name, exclusion, option)
    for name, config in CONFIGS.items()
    if issubclass(config, Options)
    for exclusion in exclusions_of(config)
    for option in exclusion.names
]


def leaves(options, prefix=""):
    """Dotted name, class and field of each option, nested ones included."""
    hints = typing.get_type_hints(options)
    for field in dataclasses.fields(options):
        if dataclasses.is_dataclass(hints[field.name]):
            yield from leaves(hints[field.name], f"{prefix}{field.name}.")
        else:
            yield f"{prefix}{field.name}", options, field


@functools.cache
def texts_of(cls):
    """The docstrings of a class's own fields, by name."""
    return {field.arg_name: field.description for field in docstring_parser.parse_from_object(cls).params}


OPTIONS = [
    (name, option, owner, field, next(texts_of(c)[field.name] for c in owner.__mro__ if field.name in texts_of(c)))
    for name, config in CONFIGS.items()
    for option, owner, field in leaves(config)
]


def example(name):
    """The options of a command's first example."""
    return parse(shlex.split(command_modules()[name].EXAMPLES[0][1])[1:])


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


def another(default, hint):
    """A value other than an option's default."""
    if isinstance(default, bool):
        return not default
    if isinstance(default, int | float):
        return type(default)(default + 1)
    if isinstance(default, tuple):
        return default[:-1]
    choices = typing.get_args(hint)
    if float in choices:
        return 0.01
    if typing.get_origin(hint) is typing.Literal:
        return next(choice for choice in choices if choice != default)
    return Path("x") if Path in (hint, *choices) else "x"


@pytest.mark.parametrize(("name", "exclusion", "option"), EXCLUDED)
def test_an_option_without_effect_is_refused(name, exclusion, option):
    """Where only bounds or other exclusions are in the way of the example, they refuse it as well."""
    config = CONFIGS[name]
    base = example(name)
    hints = typing.get_type_hints(config)
    given = {option: another(getattr(base, option), hints[option])}
    if not exclusion.applies(base):
        by_value = exclusion.values and isinstance(exclusion, Excludes)
        other = another(getattr(base, exclusion.option), hints[exclusion.option])
        given[exclusion.option] = exclusion.values[0] if by_value else other
    with pytest.raises(InvalidValueError) as refusal:
        dataclasses.replace(base, **given)
    assert "left out" in refusal.value.allowed or refusal.value.field == option


def read_names():
    """Names of attributes that are read, and texts, except where options are checked."""
    for package in (experiments, sim, trackslip):
        for file in Path(package.__file__).parent.rglob("*.py"):
            tree = ast.parse(file.read_text())
            checks = [node for node in ast.walk(tree) if checks_options(node)]
            left_out = {id(inner) for check in checks for inner in ast.walk(check)}
            for node in (node for node in ast.walk(tree) if id(node) not in left_out):
                if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load):
                    yield node.attr
                elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                    yield node.value


def checks_options(node):
    """Whether a node is a __post_init__ or declares exclusions."""
    if isinstance(node, ast.AnnAssign):
        return isinstance(node.target, ast.Name) and node.target.id == "exclusions"
    return isinstance(node, ast.FunctionDef) and node.name == "__post_init__"


def test_every_option_is_used():
    used = set(read_names())
    assert {(name, field.name) for name, _, _, field, _ in OPTIONS if field.name not in used} == set()
