"""Options without typeguard: the same, and tyro is left as it was."""

import contextlib
import shlex
import subprocess
import sys

import pytest
import tyro._resolver

from experiments import cli
from experiments.starting.quick_types import quick_types


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_options_are_those_that_typeguard_lets_through(command, monkeypatch):
    lines = [shlex.split(line)[1:] for _, line in cli.examples_of(command)]
    quick = [repr(cli.parse(line)) for line in lines]
    monkeypatch.setattr(cli, "quick_types", contextlib.nullcontext)
    assert quick == [repr(cli.parse(line)) for line in lines]
    assert quick


def test_defaults_are_compared_with_the_types_of_their_options():
    theirs = tyro._resolver.is_instance
    with quick_types():
        check = tyro._resolver.is_instance
        for value, kind in (
            (None, int | None),
            (3, int | None),
            ((1.0,), tuple[float, ...]),
            (None, tuple[int, ...] | None),
        ):
            assert check(kind, value)
            assert theirs(kind, value)
        for value, kind in (("a", int | None), (1.0, tuple[float, ...]), ("a", tuple[int, ...] | None)):
            assert not check(kind, value)
            assert not theirs(kind, value)
    assert tyro._resolver.is_instance is theirs


def test_another_version_of_tyro_does_it_its_own_way(monkeypatch):
    monkeypatch.delattr(tyro._resolver, "is_instance")
    with quick_types():
        assert not hasattr(tyro._resolver, "is_instance")


def test_a_command_starts_without_typeguard():
    code = "import sys\nfrom experiments import cli\ncli.parse(['grid'])\nprint('typeguard' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_a_brief_command_ends_as_any_other(tmp_path):
    code = "import atexit, sys\nimport experiments.__main__ as start\natexit.register(print, 'the end')\nstart.main()"
    options = ["--radii", "0.5", "1", "--speeds", "0.1", "0.2", "--duration", "4", "--out", str(tmp_path / "out")]
    line = [sys.executable, "-c", code, "reproduce", *options]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "the end"
    assert "report.html" in done.stdout.splitlines()[-2]
