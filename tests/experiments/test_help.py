"""`--help`: examples, widths, units, defaults, completion, and how quickly it comes."""

import contextlib
import dataclasses
import functools
import io
import json
import os
import re
import resource
import shlex
import shutil
import subprocess
import sys
import typing

import docstring_parser
import pytest
import tyro

from experiments.cli import COMMANDS, examples_of, examples_text, main, parse

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
    ("wander", "--duration", "1", "--out", "wander"): {"mujoco", "pyarrow"},
    ("bag",): {"pyarrow"},
    ("identify",): {"pyarrow", *DRAWN},
    ("plan",): {"mujoco", "pyarrow"},
    ("localize",): {"pyarrow", *DRAWN},
    ("deploy", "--to", "c"): set(),
    ("evaluate",): {"pyarrow", *DRAWN},
    ("drive",): {"mujoco", "pyarrow", *DRAWN},
    ("benchmark",): {"mujoco", "pyarrow", *DRAWN},
    ("train",): set(),
    ("calibrate",): {"mujoco", "pyarrow", *SCIPY},
    ("validate",): {"mujoco", "scipy.optimize", "scipy.interpolate", *DRAWN},
    ("coverage",): {"mujoco", "pyarrow"},
    ("sensitivity",): {"mujoco", *DRAWN},
    ("reproduce",): {"mujoco", "pyarrow", *DRAWN},
    ("bench",): {"mujoco", "pyarrow"},
    ("export",): {"pyarrow"},
    ("view",): {"pyarrow"},
}
"""What a command may import of HEAVY: by being run, or where only its name is given, by being got ready to run."""
PROBE = """
import contextlib, importlib, io, json, os, sys, typing
import filelock, numpy, scipy.linalg, scipy.special, rich.progress, rich.table  # light, and most commands need them
import experiments.cli as cli
heavy, tree = json.loads(sys.argv[1])
most = {"matplotlib": "matplotlib.figure", "pyarrow": "pyarrow.parquet"}  # of what takes long to import
def run(arguments):
    with contextlib.redirect_stdout(io.StringIO()):
        if arguments[1:]:
            cli.main(arguments)
        else:
            importlib.import_module(f"experiments.commands.{arguments[0]}")
    line = json.dumps([arguments, [name for name in heavy if name in sys.modules]])
    os.write(1, f"{line}\\n".encode())  # in one piece, as others write too
def forked(job, argument):
    if os.fork() == 0:  # so that what many share is imported once
        job(argument)
        os._exit(0)
    os.wait()
def walk(node):
    for arguments in node["run"]:
        forked(run, arguments)
    for name, more in node["import"].items():
        forked(lambda node: (importlib.import_module(most.get(name, name)), walk(node)), more)
walk(tree)
"""


def help_of(capsys, *command):
    with pytest.raises(SystemExit) as stop:
        main([*command, "--help"])
    assert stop.value.code == 0
    return capsys.readouterr().out


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


def text_of(options, name):
    """The docstring of an option's field."""
    return next(texts_of(cls)[name] for cls in options.__mro__ if name in texts_of(cls))


OPTIONS = [(command, *leaf) for command, options in COMMANDS.items() for leaf in leaves(options)]


def test_every_example_is_a_command():
    for command in ("", *COMMANDS):
        assert examples_of(command)
        for what, line in examples_of(command):
            assert what
            inner = re.fullmatch(r'eval "\$\((.*)\)"', line)
            name, *arguments = shlex.split(inner[1] if inner else line)
            assert name == "trackslip"
            assert not command or arguments[0] == command
            stops = "--help" in arguments or arguments[0].startswith("--tyro")
            with pytest.raises(SystemExit) if stops else contextlib.nullcontext():
                parse(arguments)


@pytest.mark.parametrize("width", [60, 80, 120])
def test_help_wraps_at_the_terminals_width_and_ends_with_examples(capsys, monkeypatch, width):
    monkeypatch.setenv("COLUMNS", str(width))
    for command in ("", *COMMANDS):
        text = help_of(capsys, *([command] if command else []))
        own, examples = text.split("examples:\n")
        assert f"examples:\n{examples}" == f"{examples_text(command)}\n"
        for line in own.splitlines():
            assert len(line) <= width, (command, line)
        assert all(len(line) <= 80 for line in examples.splitlines())


def test_help_lists_every_option_with_its_default(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "10000")
    shown = {command: help_of(capsys, command).split("examples:")[0] for command in COMMANDS}
    for command, option, owner, field in OPTIONS:
        hint = typing.get_type_hints(owner, include_extras=True)[field.name]
        if tyro.conf.Positional in getattr(hint, "__metadata__", ()):
            continue
        flag = "--" + option.removesuffix(".source").removesuffix(".force").removeprefix("bag.").replace("_", "-")
        about = re.split(rf"│ +{re.escape(flag)}[ ,]", shown[command], maxsplit=1)
        assert len(about) == 2, (command, flag)
        assert text_of(owner, field.name) in about[1], (command, flag)
        default = re.search(r"\(default: ([^)]+)", about[1].split(text_of(owner, field.name), 1)[1])
        assert default, (command, flag)
        assert default[1] != "None", (command, flag)


def test_help_texts_are_a_line_each():
    """tyro would break a line of help where the source does."""
    for _, option, owner, field in OPTIONS:
        text = text_of(owner, field.name)
        assert text.endswith((".", "]")), option
        assert "\n" not in text, option


def test_numbers_say_their_unit():
    """[-] where they have none."""
    for _, option, owner, field in OPTIONS:
        if "float" in str(typing.get_type_hints(owner)[field.name]):
            assert re.search(r"\[[^]]+\]", text_of(owner, field.name)), option


def test_help_takes_at_most_0_6_s_of_processor_time():
    """Once in a few times, as other work on the machine adds to it."""

    def seconds():
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [sys.executable, "-m", "experiments", "--help"]
        subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    assert any(seconds() < 0.6 for _ in range(5))


def test_help_loads_no_simulator():
    code = (
        "import sys, contextlib\nfrom experiments.cli import main\n"
        "with contextlib.suppress(SystemExit): main(['grid', '--help'])\n"
        f"print([m for m in {HEAVY} if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    assert "--radii" in done.stdout


@functools.cache
def completion_script(shell):
    """The script that makes a shell complete."""
    with contextlib.redirect_stdout(io.StringIO()) as printed, pytest.raises(SystemExit) as stop:
        main(["--tyro-print-completion", shell])
    assert not stop.value.code
    return printed.getvalue()


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_knows_commands_options_and_choices(shell, tmp_path):
    script = completion_script(shell)
    if shutil.which(shell):
        (tmp_path / "script").write_text(script)
        subprocess.run([shell, "-n", tmp_path / "script"], check=True)
    for word in (*COMMANDS, "ground.across", "scanner.noise", "truth"):
        assert word in script, word


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_bash_completes(tmp_path):
    script = completion_script("bash")
    (tmp_path / "script").write_text(script)
    name = re.search(r"^complete .*-F (\w+) .*trackslip", script, re.MULTILINE)[1]

    def offered(*words):
        asked = (
            f"source {tmp_path}/script; COMP_WORDS=({' '.join(map(shlex.quote, words))}); "
            f"COMP_CWORD={len(words) - 1}; COMP_LINE={shlex.quote(' '.join(words))}; COMP_POINT=${{#COMP_LINE}}; "
            f'{name} trackslip {words[-1]} {words[-2]}; echo "${{COMPREPLY[*]}}"'
        )
        done = subprocess.run(["bash", "-c", asked], capture_output=True, text=True, check=True)
        return done.stdout.split()

    assert offered("trackslip", "gr") == ["grid"]
    assert "--radii" in offered("trackslip", "grid", "--ra")
    assert offered("trackslip", "track", "--localization", "t") == ["truth"]


def test_no_command_imports_what_it_does_not_need(tmp_path):
    assert {arguments[0] for arguments in NEEDED} == set(COMMANDS)
    root = os.path.dirname(os.path.dirname(os.path.dirname(__file__)))
    tree = {"run": [], "import": {}}  # those that may import the same share it
    for arguments, allowed in NEEDED.items():
        node = tree
        for name in sorted(allowed, key=["pyarrow", "mujoco", *sorted(SCIPY | DRAWN)].index):
            node = node["import"].setdefault(name, {"run": [], "import": {}})
        node["run"].append(arguments)
    command = [sys.executable, "-c", PROBE, json.dumps([HEAVY, tree])]
    environment = os.environ | {"PYTHONPATH": root}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
    found = {tuple(arguments): set(modules) for arguments, modules in map(json.loads, done.stdout.splitlines())}
    assert found.keys() == NEEDED.keys()
    for arguments, modules in found.items():
        assert modules <= NEEDED[arguments], arguments
