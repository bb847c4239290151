"""All pages and examples in one folder, as a new user follows them: nothing is refused."""

import json
import os
import shlex
import subprocess
import sys
from collections import defaultdict

import pytest
from pages import PAGES, ROOT, PageRunner, blocks, commands

from experiments.cli import commands as all_commands
from experiments.cli import config_module, parse
from experiments.common.plain_json import plain

EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
SHORTER = {"ppo_in_one_file": {"steps": 16_384}, "training": {"steps": 8_192, "robots": 8}}
"""Arguments with which the examples that train take seconds."""


def of_pages():
    """The commands of all pages, with the name of the page."""
    for page in PAGES:
        for block in blocks(page.read_text(encoding="utf-8")):
            if block.language == "sh" and block.directive not in ("refused", "not run"):
                for words in commands(block.text):
                    yield page.name, words


def of_help(command):
    """The examples in a command's help."""
    for _, line in config_module(command).EXAMPLES:
        yield "--help", shlex.split(line)[1:]


def shared_folders(given):
    """The commands, with where they stand, that write to a folder of a command with other
    options.
    """
    of_folder = defaultdict(dict)
    for where, words in given:
        config = parse(words)
        if getattr(config, "stores_results", False) and "--resume" not in words:
            options = json.dumps([words[0], plain(config)])
            of_folder[str(config.out)].setdefault(options, f"{where}: {shlex.join(words)}")
    return [list(some.values()) for some in of_folder.values() if len(some) > 1]


def test_each_folder_of_results_belongs_to_one_command(monkeypatch):
    monkeypatch.chdir(ROOT)  # which has the files that the commands name
    assert shared_folders(of_pages()) == []


@pytest.mark.parametrize("command", all_commands())
def test_the_examples_of_a_command_run_one_after_the_other(command):
    assert shared_folders(of_help(command)) == []


def follow(page, folder, captured):
    """Run the blocks of a page in a folder."""
    runner = PageRunner(folder, captured, slow=True)
    for block in blocks(page.read_text(encoding="utf-8")):
        try:
            runner.run(block)
        except BaseException as error:
            raise AssertionError(f"{page.name}, line {block.line}: {error!r}") from error


def run_example(file, folder):
    """Run an example in a process of its own, in a folder with the examples."""
    path = f"examples/{file.name}"
    call = f"runpy.run_path({path!r}, run_name='__main__')"
    if file.stem in SHORTER:
        call = f"runpy.run_path({path!r})['main'](**{SHORTER[file.stem]})"
    done = subprocess.run(
        [sys.executable, "-c", f"import runpy; {call}"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
@pytest.mark.filterwarnings("default::trackslip.errors.RobotWarning")  # commands print them
@pytest.mark.parametrize("order", [1, -1], ids=["as listed", "reversed"])
def test_all_pages_run_in_one_folder_in_any_order(workplace, capsys, order):
    """The second time, in the other order, all commands have their results stored."""

    def captured():
        return "".join(capsys.readouterr())

    for page in PAGES[::order]:
        follow(page, workplace, captured)
    for page in PAGES[::-order]:
        follow(page, workplace, captured)


@pytest.mark.slow
def test_examples_write_under_out_only(tmp_path):
    pytest.importorskip("stable_baselines3")
    pytest.importorskip("polars")
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    for file in EXAMPLES:
        run_example(file, tmp_path)
    assert {path.name for path in tmp_path.iterdir()} <= {"examples", "out", "MUJOCO_LOG.TXT"}
