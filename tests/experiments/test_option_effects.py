"""Every option of every command changes the result, or is refused."""

import itertools

import pytest
from option_effects import CASES, QUICK, options_of, outcome, write_inputs

from experiments.cli import commands, main


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """The paths in the table, by name."""
    return write_inputs(tmp_path_factory.mktemp("inputs"))


@pytest.fixture(scope="module")
def driven(inputs):
    """Drive what the table reads."""
    grid = ("--radii", "0.5", "1.5", "--speeds", "0.1", "0.25", "--duration", "8")
    main(["grid", *grid, "--executor", "inline", "--out", inputs["grid"]])
    main(["wander", "--duration", "40", "--out", inputs["wander"]])


@pytest.fixture
def tried(tmp_path, inputs, monkeypatch):
    """A function that runs words and returns exit code, results and message, each line once."""
    monkeypatch.setattr("trackslip.planning.plan.MAX_EVALUATIONS", 30)
    monkeypatch.setattr("trackslip.planning.plan.MIN_EVALUATIONS", 30)
    # its own take minutes
    monkeypatch.setattr("experiments.tune.TRAINING_PATHS", (inputs["straight"],))
    numbers = itertools.count()
    done = {}

    def run(*words):
        line = " ".join(words).format(**inputs)
        if line not in done:
            done[line] = outcome(line, tmp_path / str(next(numbers)))
        return done[line]

    return run


@pytest.mark.parametrize("command", commands())
def test_every_option_has_an_entry(command):
    assert set(CASES[command].options) == options_of(command)


def without_effect(case, tried):
    """The options that are accepted and change nothing, each with the words that were tried."""
    for name, entry in case.options.items():
        if entry.startswith("~"):
            continue
        context, _, words = entry.rpartition("|")
        code, before, message = tried(case.line, context)
        assert code in (0, 1), (name, context, message)
        code, after, message = tried(case.line, context, words)
        if code in (0, 1) and after == before:
            yield name, entry
        assert code in (0, 1), (name, words, message)
        if context and name != "reference" and tried(case.line, words)[0] == 0:
            assert tried(case.line, words)[1] != tried(case.line)[1], (name, words)


def not_refused(case, tried):
    """The words of a case that are accepted although they have no effect."""
    for name, words in case.more.items():
        code, _, message = tried(case.line, words)
        if code != 2 or f"{name} = " not in message or "left out" not in message:
            yield name, words, message


@pytest.mark.parametrize("command", QUICK)
def test_options_of_a_quick_command_have_an_effect(command, tried):
    assert [*without_effect(CASES[command], tried)] == []


@pytest.mark.slow
@pytest.mark.usefixtures("driven")
@pytest.mark.parametrize("command", [name for name in CASES if name not in QUICK])
def test_options_of_a_command_have_an_effect(command, tried):
    if command == "train":
        pytest.importorskip("stable_baselines3")
    assert [*without_effect(CASES[command], tried)] == []


@pytest.mark.parametrize("command", CASES)
def test_options_without_effect_are_refused(command, tried):
    assert [*not_refused(CASES[command], tried)] == []
