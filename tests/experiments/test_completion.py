import re
import subprocess

import pytest

from experiments.cli import main
from experiments.completion import SCRIPTS, commands


def script(capsys, shell):
    main(["completion", shell])
    return capsys.readouterr().out


@pytest.fixture
def complete(capsys, tmp_path):
    """What bash offers for each of some lines, when Tab is pressed at their ends."""
    (tmp_path / "script").write_text(script(capsys, "bash"))
    subprocess.run(["bash", "-n", tmp_path / "script"], check=True)

    def offers(*lines):
        pressed = 'COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); _trackslip; echo "${COMPREPLY[*]}"'
        words = [line + "''" if line.endswith(" ") else line for line in lines]
        asked = "".join(f"COMP_WORDS=({line}); {pressed}\n" for line in words)
        command = ["bash", "-c", f"set -u; source {tmp_path / 'script'}\n{asked}"]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        assert done.stderr == ""
        return [line.split() for line in done.stdout.splitlines()]

    return offers


def test_bash_completes_commands_options_and_values(complete):
    assert complete(
        "trackslip ",
        "trackslip gr",
        "trackslip grid --ra",
        "trackslip grid --ground.",
        "trackslip grid --localization ",
        "trackslip track --localization t",
        "trackslip calibrate --free com_x friction",
        "trackslip benchmark --controllers linear pure",
        "trackslip completion ",
        "trackslip identify out",  # a file: left to the shell
    ) == [
        ["--help", *commands()],
        ["grid"],
        ["--radius-error", "--radii", "--random-phase"],
        ["--ground.along", "--ground.across", "--ground.slope", "--ground.uphill"],
        ["plate", "line"],
        ["truth"],
        ["friction_ratio"],
        ["pure_pursuit"],
        ["bash", "zsh", "fish"],
        [],
    ]


def test_what_is_offered_is_what_help_lists(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    for command, known in commands().items():
        with pytest.raises(SystemExit):
            main([command, "--help"])
        text = capsys.readouterr().out.split("examples:")[0]
        listed = [line for line in text.splitlines() if re.match(r"[^-\w]{0,2}--?\w", line)]
        options = {option for line in listed for option in re.findall(r"(?<![\w-])--[a-z][a-z.-]*", line[:60])}
        assert set(known) == options, command


def test_other_shells(capsys):
    assert set(SCRIPTS) == {"bash", "zsh", "fish"}
    assert script(capsys, "zsh").endswith(script(capsys, "bash"))
    lines = script(capsys, "fish").splitlines()
    assert all(line.startswith("complete -c trackslip -n ") for line in lines)
    assert (
        "complete -c trackslip -n '__fish_seen_subcommand_from track' -l localization -r -a 'plate line truth'" in lines
    )
