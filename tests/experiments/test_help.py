"""`--help`: examples, widths, units, defaults, completion, and how quickly it comes."""

import contextlib
import re
import shlex
import shutil
import subprocess
import sys

import pytest

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


def test_commands_import_what_they_need_when_they_run():
    code = (
        "import sys\nfrom experiments.cli import command_modules\ncommand_modules()\n"
        f"print([name for name in {HEAVY} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_knows_commands_options_and_choices(shell, tmp_path, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["--tyro-print-completion", shell])
    script = capsys.readouterr().out
    assert not stop.value.code
    for word in (*MODULES, "ground.across", "scanner.noise", "truth"):
        assert word in script, word
    (tmp_path / "script").write_text(script)
    if shutil.which(shell):
        subprocess.run([shell, "-n", tmp_path / "script"], check=True)
    if shell != "bash":
        return
    name = re.search(r"^complete .*-F (\w+) .*trackslip", script, re.MULTILINE)[1]
    for words, offered in (("gr", "grid"), ("grid --ra", "--radii"), ("track --localization t", "truth")):
        *before, last = ["trackslip", *words.split()]
        asked = (
            f"source {tmp_path}/script; COMP_WORDS=(trackslip {words}); COMP_CWORD={len(before)}; "
            f"COMP_LINE='trackslip {words}'; COMP_POINT=${{#COMP_LINE}}; "
            f'{name} trackslip {last} {before[-1]}; echo "${{COMPREPLY[*]}}"'
        )
        done = subprocess.run(["bash", "-c", asked], capture_output=True, text=True, check=True)
        assert offered in done.stdout.split()
