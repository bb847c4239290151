import os
import re
import shlex
import signal
import subprocess
import sys

import pytest
from bags import write_bag

from experiments.cli import EXAMPLES, commands, config_module, main, parse


def printed_by(capsys, *command):
    with pytest.raises(SystemExit) as stop:
        main([*command])
    assert not stop.value.code
    return capsys.readouterr().out


@pytest.mark.parametrize("command", commands())
def test_help_ends_with_examples_that_parse(command, capsys):
    text = printed_by(capsys, command, "--help-all")
    assert "{True,False}" not in text  # tyro takes no value after such an option
    assert all(len(line) <= 80 for line in text.split("examples:\n")[1].splitlines())
    examples = config_module(command).EXAMPLES
    assert examples
    for what, line in examples:
        program, name, *_ = words = shlex.split(line)
        assert (program, name, bool(what)) == ("trackslip", command, True)
        parse(words[1:])


@pytest.mark.parametrize("command", commands())
def test_help_fits_on_a_screen_and_leads_to_all_options(command, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    short = printed_by(capsys, command, "--help").splitlines()
    everything = printed_by(capsys, command, "--help-all")
    assert len(short) <= 50
    flags = re.findall(r"^\W+(--[\w.-]+)", "\n".join(short), re.M)
    assert flags
    assert set(flags) <= set(re.findall(r"^\W+(--[\w.-]+)", everything, re.M))
    is_short = len(short) < len(everything.splitlines())
    assert (short[-1] == f"all options and examples: trackslip {command} --help-all") == is_short


TYPOS = {
    "indentify log.csv": "identify",
    "grid --robot huskey": "husky",
    "grid --ground stne": "stone",
    "track --controller linaer": "linear",
    "track --controller linaer:stiffness=2": "linear",
    "track --compensation icr_raduis": "icr_radius",
    "track --reference papr": "paper",
    "deploy --law icr_raduis": "icr_radius",
    "drive --course stair": "stairs",
}


@pytest.mark.parametrize("line", TYPOS)
def test_a_name_with_a_typo_is_guessed(line, refused):
    assert refused(*line.split()).endswith(f"(did you mean {TYPOS[line]}?)")


def test_a_name_that_is_like_no_other_is_not_guessed(refused):
    assert "did you mean" not in refused("grid", "--robot", "xyzzy")


@pytest.mark.parametrize("arguments", [[], ["-h"], ["--help"]])
def test_help_lists_each_command_once_with_what_it_does(arguments, capsys):
    main(arguments)
    text, _, examples = capsys.readouterr().out.partition("examples:\n")
    _, *groups = re.split(r"^([a-z]+):$", text, flags=re.M)
    headings = groups[::2]
    assert headings == ["simulate", "identify", "control", "robots", "logs"]
    listed = [line.split(None, 1) for block in groups[1::2] for line in block.split("\n") if line]
    assert sorted(listed) == [[name, sentence] for name, sentence in commands().items()]
    for what, line in EXAMPLES:
        assert f"  {line}\n      {what}\n" in examples


def test_python_m_trackslip_lists_commands_without_imports():
    command = [sys.executable, "-X", "importtime", "-m", "trackslip", "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert all(name in done.stdout for name in commands())
    imported = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    shared = ("common.interrupts", "common.leftovers", "common.streams", "common.temporary")
    ours = {name for name in imported if name.startswith("experiments.")}
    assert ours == {f"experiments.{name}" for name in ("cli", "common", *shared)}


def test_an_interrupt_prints_one_line_while_modules_are_imported():
    """A module finder holds the import until the interrupt arrives; a second one doesn't stop what
    cleans up.
    """
    code = (
        "import sys, time\nimport experiments.__main__ as start\nclass Finder:\n  def "
        "find_spec(self, name, *_):\n"
        "    if name == 'experiments.predict':\n      try:\n        print(1, flush=True), "
        "time.sleep(60)\n"
        "      finally:\n        print(2, flush=True), time.sleep(1), print(3, flush=True)\n"
        "sys.meta_path.insert(0, Finder())\nsys.argv = ['trackslip', 'predict']\nstart.main()"
    )
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", code], **pipes) as process:
        for line in ("1\n", "2\n"):
            assert process.stdout.readline() == line
            process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=30) == ("3\n", "trackslip: interrupted\n")
    assert process.returncode == 130


def test_an_output_path_that_is_a_file(refused, tmp_path):
    (tmp_path / "file").write_text("mine")
    for command, path in (("grid", "file"), ("grid", "file/below"), ("deploy", "a" * 300)):
        assert f"{path}: can't be written" in refused(
            command, "--out", str(tmp_path / path)
        ).replace("':", ":")
    assert (tmp_path / "file").read_text() == "mine"
    (tmp_path / "loop").symlink_to("loop")
    for command in ("predict", f"evaluate {tmp_path / 'file'}"):
        assert "can't be written" in refused(
            *command.split(), "--out", str(tmp_path / "loop" / "below")
        )


@pytest.mark.filterwarnings("default")
def test_a_warning_is_one_line_without_code(tmp_path, capsys):
    (tmp_path / "wide.toml").write_text("half_gauge = 0.6\n")
    short = ("--radii", "3", "--speeds", "0.1", "--duration", "4", "--out", str(tmp_path / "out"))
    main(["grid", "--robot", str(tmp_path / "wide.toml"), *short])
    line = "warning: half_gauge = 0.6: turns are verified up to 0.51 m, 1.5 contact lengths"
    assert [one for one in capsys.readouterr().err.splitlines() if "arning" in one] == [line]


@pytest.mark.parametrize(
    ("line", "field"),
    [
        (("grid", "--out", "a\udcff"), "out"),
        (("grid", "--out=a\udcff"), "out"),
        (("track", "--reference", "\udcfe.csv"), "reference"),
        (("identify", "\udcff"), "argument"),
        (("\udcff",), "argument"),
    ],
)
def test_an_argument_that_is_not_utf_8_is_refused(refused, line, field):
    line = refused(*line)
    assert line.startswith(f"{field} = ")
    assert line.endswith("must be text in UTF-8")


NOT_UTF_8 = os.fsdecode(b"run \xff")


def test_bags_whose_names_are_not_utf_8_are_refused(refused, tmp_path):
    write_bag(tmp_path / "bags" / NOT_UTF_8, "sqlite3", [])
    line = refused("log", str(tmp_path / "bags"))
    assert line.endswith("its path must be text in UTF-8: rename it")


def test_results_may_lie_in_a_folder_that_is_not_utf_8(tmp_path, monkeypatch):
    folder = tmp_path / NOT_UTF_8
    folder.mkdir()
    monkeypatch.chdir(folder)
    main(["predict", "--out", "theory"])
    assert (folder / "theory" / "summary.json").is_file()
