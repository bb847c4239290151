"""What a command may delete, and what is whole whenever it is killed or interrupted."""

import json
import os
import shutil
from contextlib import contextmanager

import pytest

from experiments.common.results_folder import results_folder
from trackslip.errors import OutputError
from trackslip.files import known_manifest
from trackslip.replacement import (
    CHECKPOINT_FILE,
    DRAFT,
    LOCK,
    MOVING,
    STORE,
    SWEEP_FILE,
    sizes,
)

OLD = {"runs.parquet": "old", "report.html": "old page", "figures/a.svg": "a", "figures/b.svg": "b"}
NEW = {"runs.parquet": "new!", "summary.json": "{}", "figures/a.svg": "A", "pictures/1.png": "1"}
STORED = {f"{STORE}/{letter * 32}.json": letter for letter in "abc"}
OPERATIONS = ("mkdir", "rename", "replace", "unlink", "rmdir")


def write(folder, files):
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


def write_results(folder, files, command="grid"):
    """What a command writes: files and a manifest, whose list of files it doesn't make itself."""
    write(folder, files)
    manifest = {"command": command, "versions": {"trackslip": "1"}}
    (folder / "manifest.json").write_text(json.dumps(manifest))


def run_command(out, files=NEW, overwrite=True, resumed=SWEEP_FILE, meanwhile=None):
    with results_folder(out, overwrite, resumed) as draft:
        write_results(draft, files)
        write(out, meanwhile or {})


def contents(folder):
    """Texts of all files in a folder, without the manifest, by path; and its empty folders."""
    texts = {path: (folder / path).read_text() for path in sizes(folder) if path != "manifest.json"}
    empty = [path for path in folder.rglob("*") if path.is_dir() and not any(path.iterdir())]
    return texts | {str(path.relative_to(folder)): "" for path in empty}


@pytest.fixture
def old(tmp_path):
    """A folder with old results."""
    run_command(tmp_path / "out", OLD, overwrite=False)
    return tmp_path / "out"


def test_results_replace_old_results_as_a_whole(old):
    assert contents(old) == OLD
    run_command(old)
    assert contents(old) == NEW
    listed = known_manifest(old)["files"]
    assert listed == {name: len(text) for name, text in NEW.items()}


def refusal(out, **options):
    before = {path: path.lstat() for path in out.rglob("*")}
    with pytest.raises(OutputError) as error:
        run_command(out, **options)
    assert {path: path.lstat() for path in out.rglob("*")} == before
    return str(error.value)


@pytest.mark.parametrize("name", [".git", ".ssh", ".bashrc", "thesis.tex", "empty", ".lock"])
@pytest.mark.parametrize("overwrite", [False, True])
def test_what_is_no_result_makes_a_command_refuse(tmp_path, old, name, overwrite):
    for out in (tmp_path / "new", old):
        out.mkdir(exist_ok=True)
        (out / name).mkdir() if name in (".git", "empty") else (out / name).write_text("mine")
        assert f"contains {name}, which is no result" in refusal(out, overwrite=overwrite)


def test_this_folder_is_refused_for_its_hidden_files(tmp_path, monkeypatch, refused):
    monkeypatch.chdir(tmp_path)
    write(tmp_path, {".git/HEAD": "ref: refs/heads/main", ".bashrc": "alias"})
    for out in (".", ""):
        assert "which is no result of trackslip" in refused("predict", "--out", out)
        assert "which is no result" in refused("predict", "--out", out, "--overwrite")


@pytest.mark.parametrize(
    "manifest",
    [
        '{"name": "a web page", "icons": []}',
        '{"files": {"index.html": 4}, "command": "x", "versions": {}}',
        '{"files": {"index.html": -1}, "command": "x", "versions": {"trackslip": "1"}}',
        '{"files": ["index.html"], "command": "x", "versions": {"trackslip": "1"}}',
    ],
)
def test_a_manifest_of_others_lists_nothing(tmp_path, manifest):
    write(tmp_path / "web", {"index.html": "page", "manifest.json": manifest})
    for overwrite in (False, True):
        refusal(tmp_path / "web", overwrite=overwrite)


def test_results_without_a_list_are_moved_by_the_user(tmp_path):
    write_results(tmp_path / "out", OLD)
    assert "results of trackslip 1, whose manifest lists no files" in refusal(tmp_path / "out")


def test_a_file_that_was_changed_is_kept(old):
    (old / "report.html").write_text("old page, with my notes")
    assert "contains report.html, which has changed" in refusal(old)


def test_a_file_that_was_deleted_is_not_missed(old):
    (old / "report.html").unlink()
    run_command(old)
    assert contents(old) == NEW


@pytest.mark.parametrize("name", ["runs.parquet", "figures", STORE, DRAFT, MOVING, LOCK])
def test_links_are_not_followed(tmp_path, old, name):
    elsewhere = tmp_path / "elsewhere"
    write(elsewhere, {"a.svg": "a", ".replaced.json": "{}", "runs.parquet": "old"})
    target = elsewhere / name if (elsewhere / name).is_file() else elsewhere
    shutil.rmtree(old / name) if (old / name).is_dir() else (old / name).unlink(missing_ok=True)
    (old / name).symlink_to(target)
    before = contents(elsewhere)
    assert f"contains {name}" in refusal(old)
    assert contents(elsewhere) == before


def test_a_folder_that_a_link_names_is_used(tmp_path, old):
    (tmp_path / "link").symlink_to(old)
    run_command(tmp_path / "link")
    assert contents(old) == NEW


@pytest.mark.parametrize("name", [STORE, DRAFT])
def test_own_names_with_files_of_others_are_kept(old, name):
    write(old, {f"{name}/notes.txt": "mine"})
    assert f"contains {name}, which is no result" in refusal(old)


def test_unfinished_work_is_resumed_or_kept(tmp_path):
    write(tmp_path / "out", STORED)
    options = {"overwrite": False, "resumed": CHECKPOINT_FILE}
    assert "work of an unfinished command" in refusal(tmp_path / "out", **options)
    run_command(tmp_path / "out", overwrite=False)
    assert contents(tmp_path / "out") == NEW


def test_a_file_that_appears_meanwhile_is_not_replaced(tmp_path):
    out = tmp_path / "out"
    with pytest.raises(OutputError, match="appeared while"):
        run_command(out, overwrite=False, meanwhile={"summary.json": "mine"})
    assert contents(out) == {"summary.json": "mine"}


def test_a_block_without_a_manifest_replaces_nothing(old):
    with results_folder(old, overwrite=True) as draft:
        (draft / "runs.parquet").write_text("half")
    assert contents(old) == OLD


def test_a_manifest_cannot_name_files_outside(tmp_path, old):
    write(tmp_path, {"outside": "12"})
    manifest = json.loads((old / "manifest.json").read_text())
    manifest["files"] |= {"../outside": 2, str(tmp_path / "outside"): 2}
    (old / "manifest.json").write_text(json.dumps(manifest))
    run_command(old)
    assert (tmp_path / "outside").read_text() == "12"


def test_a_move_that_a_stranger_began_stays_inside(tmp_path):
    out = tmp_path / "out"
    outside = tmp_path / "outside"
    outside.mkdir()
    write(out, {f"{MOVING}/figures/a.svg": "a", f"{MOVING}/.replaced.json": '{"../x": 1}'})
    (out / "figures").symlink_to(outside)
    with pytest.raises(OutputError, match="must be a folder"):
        known_manifest(out)
    assert not list(outside.iterdir())


class Died(BaseException):
    """The process is killed."""


@contextmanager
def stopped_at(monkeypatch, operation, killed):
    """Stop at the numbered file operation: by an interrupt or, if killed, so that none follows.

    Yields the names of the operations that were begun.
    """
    begun = []

    def stopping(name):
        real = getattr(os, name)

        def do(*arguments, **options):
            begun.append(name)
            if killed and len(begun) > operation:
                raise Died
            if not killed and len(begun) == operation + 1:
                raise KeyboardInterrupt
            return real(*arguments, **options)

        return do

    with monkeypatch.context() as patch:
        for name in OPERATIONS:
            patch.setattr(os, name, stopping(name))
        yield begun


@pytest.mark.parametrize("before", [OLD, STORED, OLD | STORED], ids=["old", "store", "both"])
@pytest.mark.parametrize("killed", [True, False], ids=["SIGKILL", "SIGTERM"])
@pytest.mark.parametrize("reads", [True, False])
def test_whenever_it_stops_nothing_is_lost(tmp_path, monkeypatch, before, killed, reads):
    """The old results and the store, or the new results, are whole; the next command sees them."""
    results = {name: text for name, text in before.items() if not name.startswith(STORE)}
    stored = {name: text for name, text in before.items() if name.startswith(STORE)}
    out = tmp_path / "out"
    operation = 0
    stopped = True
    outcomes = []
    while stopped:
        shutil.rmtree(out, ignore_errors=True)
        if results:
            run_command(out, results, overwrite=False)
        write(out, stored)
        try:
            with stopped_at(monkeypatch, operation, killed) as begun:
                run_command(out, overwrite=bool(results))
        except (Died, KeyboardInterrupt):
            pass
        stopped = len(begun) > operation
        require_whole(out, before)
        if reads:
            known_manifest(out)
        else:
            with results_folder(out, overwrite=True, resumed=SWEEP_FILE):
                pass
        outcomes.append(require_one(out, before))
        run_command(out, overwrite=True)
        assert contents(out) == NEW
        operation += 1
    assert operation > 10
    assert outcomes == sorted(outcomes)  # old ones until an operation, new ones from it on
    assert set(outcomes) == {"a: before", "b: after"}


def require_whole(out, before):
    """Before any command mends it: all of the old files are there, or all of the new ones."""
    there = contents(out)
    moving = {f"{MOVING}/{name}": text for name, text in NEW.items()}
    has_new = all(there.get(f"{MOVING}/{n}", there.get(n)) == text for n, text in NEW.items())
    assert before.items() <= there.items() or has_new, (there, moving)


def require_one(out, before):
    """After a command has mended it: nothing but the old files, or nothing but the new ones."""
    there = {n: t for n, t in contents(out).items() if n not in (LOCK, DRAFT)}
    there = {name: text for name, text in there.items() if not name.startswith(f"{DRAFT}/")}
    if there == before:
        return "a: before"
    assert there == NEW, there
    return "b: after"
