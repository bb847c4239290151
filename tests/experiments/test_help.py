import contextlib
import json
import os
import re
import resource
import shlex
import subprocess
import sys
import typing

import pytest
from experiments.examples import EXAMPLES, examples_text

from experiments.cli import Command, main, parse

COMMANDS = [typing.get_args(part)[1].name for part in typing.get_args(Command)]
HEAVY = (
    *("mujoco", "torch", "stable_baselines3", "casadi", "rerun", "pyarrow", "matplotlib", "jinja2"),
    *("scipy.stats", "scipy.signal", "scipy.optimize", "scipy.interpolate"),
)
DRAWN = {"matplotlib", "jinja2"}
SCIPY = {"scipy.optimize", "scipy.interpolate"}
PATH = ("--reference", "circle", "--circle-duration", "5", "--localization", "truth")
NEEDED = {
    ("grid",): {"mujoco", "pyarrow"},
    ("predict", "--out", "predict"): set(),
    ("track", *PATH, "--out", "track"): {"mujoco", "pyarrow"},
    ("identify",): {"pyarrow"},
    ("benchmark",): {"mujoco", "pyarrow", *DRAWN},
    ("train",): set(),
    ("calibrate",): {"mujoco", "pyarrow", *SCIPY},
    ("validate",): {"mujoco", "scipy.optimize", "scipy.interpolate", *DRAWN},
    ("coverage",): {"mujoco", "pyarrow"},
    ("sensitivity",): {"mujoco", *DRAWN},
    ("reproduce",): {"mujoco", *DRAWN},
    ("bench",): {"mujoco"},
    ("completion", "bash"): set(),
    ("export",): {"pyarrow"},
    ("view",): {"pyarrow"},
}
"""What a command may import of HEAVY: by being run, or where only its name is given, by being got ready to run."""
PROBE = """
import contextlib, importlib, io, json, os, sys, typing
import experiments.cli as cli
heavy, jobs = json.loads(sys.argv[1])
for k, arguments in enumerate(jobs):
    if k > 1:
        os.wait()  # two at a time
    if os.fork() == 0:  # so that what all share is imported once
        with contextlib.redirect_stdout(io.StringIO()):
            if arguments[1:]:
                cli.main(arguments)
            else:
                parts = map(typing.get_args, typing.get_args(cli.Command))
                runners = {about.name: cli._RUNNERS[config] for config, about in parts}
                importlib.import_module(runners[arguments[0]])
        line = json.dumps([arguments, [name for name in heavy if name in sys.modules]])
        os.write(1, f"{line}\\n".encode())  # in one piece, as others write too
        os._exit(0)
os.wait()
os.wait()
"""


def help_of(capsys, *command):
    with pytest.raises(SystemExit) as stop:
        main([*command, "--help"])
    assert stop.value.code == 0
    return capsys.readouterr().out


def test_every_command_has_examples_and_every_example_is_a_command():
    assert set(EXAMPLES) == {"", *COMMANDS}
    for command, examples in EXAMPLES.items():
        for what, line in examples:
            assert what
            inner = re.fullmatch(r'eval "\$\((.*)\)"', line)
            name, *arguments = shlex.split((inner[1] if inner else line).split(" > ")[0])
            assert name == "trackslip"
            if command:
                assert arguments[0] == command
            with contextlib.nullcontext() if "--help" not in arguments else pytest.raises(SystemExit):
                parse(arguments)  # raises for what is wrong with it


def test_help_ends_with_the_examples_and_is_no_wider_than_80_columns(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    for command in ("", *COMMANDS):
        text = help_of(capsys, *([command] if command else []))
        assert text.endswith(f"{examples_text(command)}\n")
        assert max(map(len, examples_text(command).splitlines())) <= 80


def test_help_takes_less_than_half_a_second():
    """Of processor time: the machine may be busy with something else."""

    def seconds():
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [sys.executable, "-m", "experiments", "--help"]
        subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    assert min(seconds() for _ in range(3)) < 0.5


def test_no_command_imports_what_it_does_not_need(tmp_path):
    assert {arguments[0] for arguments in NEEDED} == set(COMMANDS)
    root = os.path.dirname(os.path.dirname(os.path.dirname(__file__)))
    command = [sys.executable, "-c", PROBE, json.dumps([HEAVY, list(NEEDED)])]
    environment = os.environ | {"PYTHONPATH": root}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    found = {tuple(arguments): set(modules) for arguments, modules in map(json.loads, done.stdout.splitlines())}
    assert found.keys() == NEEDED.keys()
    for arguments, modules in found.items():
        assert modules <= NEEDED[arguments], arguments


def test_an_interrupt_while_it_is_still_loading_costs_a_line():
    code = (
        "import sys, types\nfrom experiments.__main__ import main\n"
        "def find_spec(name, *_):\n    if name == 'tyro':\n        raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, types.SimpleNamespace(find_spec=find_spec))\nmain()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (130, "trackslip: interrupted\n")
