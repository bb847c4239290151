"""`--help`: examples, widths, units, defaults, completion, and how quickly it comes."""

import contextlib
import dataclasses
import functools
import io
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

from experiments.cli import EXAMPLES, command_modules, examples_text, main, parse

HEAVY = (
    "mujoco",
    "torch",
    "stable_baselines3",
    "casadi",
    "rerun",
    "pyarrow",
    "matplotlib",
    "rosbags",
    "scipy.optimize",
)
"""What commands import only when they run."""
MODULES = command_modules()


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


OPTIONS = [(command, *leaf) for command, module in MODULES.items() for leaf in leaves(module.Config)]


def test_every_example_is_a_command():
    for command in ("", *MODULES):
        examples = MODULES[command].EXAMPLES if command else EXAMPLES
        assert examples
        for what, line in examples:
            assert what
            inner = re.fullmatch(r'eval "\$\((.*)\)"', line)
            name, *arguments = shlex.split(inner[1] if inner else line)
            assert name == "trackslip"
            assert not command or arguments[0] == command
            stops = "--help" in arguments or arguments[0].startswith("--tyro")
            with pytest.raises(SystemExit) if stops else contextlib.nullcontext():
                parse(arguments)


def test_help_ends_with_examples(capsys):
    for command in ("", *MODULES):
        text = help_of(capsys, *([command] if command else []))
        assert text.endswith(f"{examples_text(command)}\n")
        assert all(len(line) <= 80 for line in text.split("examples:\n")[1].splitlines())


def test_help_lists_every_option_with_its_default(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    shown = {command: help_of(capsys, command).split("examples:")[0] for command in MODULES}
    for command, option, owner, field in OPTIONS:
        hint = typing.get_type_hints(owner, include_extras=True)[field.name]
        if tyro.conf.Positional in getattr(hint, "__metadata__", ()):
            continue
        flag = "--" + option.removesuffix(".source").removesuffix(".force").removeprefix("bag.").replace("_", "-")
        about = re.split(rf"\n[│ ] +{re.escape(flag)}[ ,]", shown[command], maxsplit=1)
        assert len(about) == 2, (command, flag)
        shown_text, text = ("".join(some.replace("│", "").split()) for some in (about[1], text_of(owner, field.name)))
        assert text in shown_text, (command, flag)
        default = re.search(r"\(default:([^)]+)", shown_text.split(text, 1)[1])
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


def test_help_takes_at_most_a_second_of_processor_time():
    """Once in a few times, as other work on the machine adds to it."""

    def seconds():
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [sys.executable, "-m", "experiments", "--help"]
        subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    assert any(seconds() < 1.0 for _ in range(5))


def test_commands_import_what_they_need_when_they_run():
    code = (
        "import sys\nfrom experiments.cli import command_modules\ncommand_modules()\n"
        f"print([name for name in {HEAVY} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


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
    for word in (*MODULES, "ground.across", "scanner.noise", "truth"):
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
