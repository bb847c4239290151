import json
import os
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pyarrow
import pyarrow.parquet
import pytest

from experiments.cli import main
from experiments.common.results import file_names, write_output
from experiments.common.results_folder import results_folder
from trackslip.files import FORMAT
from trackslip.laws.file import SHIPPED

ROOT = Path(__file__).parents[3]
TRACK = ("track", "--reference", "circle", "--circle-duration", "5", "--localization", "truth")


def command(*arguments, **options):
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    whole = [sys.executable, "-m", "experiments", *arguments]
    return subprocess.Popen(whole, env=environment, text=True, stderr=subprocess.PIPE, **options)


def contents(folder):
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {str(file.relative_to(folder)): file.read_bytes() for file in files}


@pytest.fixture(scope="module")
def tracked(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tracked") / "track"
    main([*TRACK, "--out", str(folder)])
    return folder


@pytest.fixture
def old(tracked, tmp_path):
    return Path(shutil.copytree(tracked, tmp_path / "track"))


@pytest.mark.parametrize("size", [500, 20_000])  # too little for the summary; for the runs
def test_a_full_disk_costs_a_line_and_nothing_old(old, refused, size):
    """A limit on file sizes fails in the midst of writing, as a full disk does."""
    before = contents(old)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    _, most = limits
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, most))
    try:
        line = refused(*TRACK, "--seed", "1", "--overwrite", "--out", str(old))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert line == f"out = {str(old)!r}: can't be written (File too large)"
    assert contents(old) == before


def test_what_is_not_replaced(refused, tmp_path):
    with results_folder(tmp_path / "out", overwrite=False):
        assert refused("predict", "--out", "out") == "out = 'out': another command is writing there"
    os.mkfifo(tmp_path / "pipe")
    line = refused("deploy", "--law", "icr", "--out", "pipe", "--overwrite")
    assert line == "pipe: can't be replaced (it is not a regular file)"
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "thesis.tex").touch()
    line = refused("predict", "--out", "thesis", "--overwrite")
    assert line.startswith("out = 'thesis': contains thesis.tex, which is no result of trackslip")


def test_a_killed_command_locks_nothing_and_its_leftovers_go(old):
    before = contents(old)
    process = command("grid", "--out", str(old), "--overwrite")
    while not (old / ".draft").exists():
        assert process.poll() is None
        time.sleep(0.005)
    process.kill()
    process.communicate()
    assert before.keys() <= contents(old).keys()
    assert {".lock", ".draft"} <= {file.name for file in old.iterdir()}
    with results_folder(old, overwrite=True) as folder:
        for name in before:
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_bytes(before[name])
    assert contents(old) == before


def test_results_are_replaced_only_on_request(old, refused):
    before = contents(old)
    predict = ("predict", "--out", str(old))
    assert refused(*predict) == f"out = {str(old)!r}: contains results; --overwrite replaces them"
    assert contents(old) == before
    main([*predict, "--overwrite"])
    assert json.loads((old / "manifest.json").read_text())["command"] == "predict"
    assert {file.name for file in old.iterdir()} == {"manifest.json", "summary.json"}


def test_results_of_a_newer_version_are_told_from_this_ones(refused, old, tmp_path):
    assert json.loads((old / "manifest.json").read_text())["format"] == FORMAT
    (old / "summary.json").write_text(SHIPPED.read_text())
    (old / "manifest.json").write_text(json.dumps({"format": 2, "versions": {"trackslip": "9.8"}}))
    for command in (
        "identify {}",
        "calibrate --target {}",
        "track --laws {}",
        "benchmark --laws {}",
    ):
        message = refused(*command.format(old).split())
        assert message.startswith(
            f"{old / 'manifest.json'}: written by trackslip 9.8 in format 2; "
        )
        assert message.endswith(" reads formats up to 1")
    (tmp_path / "laws.json").write_text(json.dumps(json.loads(SHIPPED.read_text()) | {"format": 3}))
    assert "laws.json: written by a newer trackslip in format 3; " in refused(
        *TRACK, "--laws", "laws.json"
    )
    table = pyarrow.parquet.read_table(old / "runs.parquet")
    stored = json.loads(table.schema.metadata[b"trackslip"])
    table = table.replace_schema_metadata({b"trackslip": json.dumps(stored | {"format": 2})})
    pyarrow.parquet.write_table(table, tmp_path / "runs.parquet")
    assert "runs.parquet: written by a newer trackslip in format 2; " in refused(
        "identify", "runs.parquet"
    )


@pytest.mark.parametrize("name", ["a", "é", "速", "𠀀"])
def test_file_names_are_limited_in_bytes(name):
    names = [100 * name, 100 * name, 300 * name]
    files = file_names(names, ".rrd")
    assert len(set(files)) == len(names)
    assert all(len(os.fsencode(file)) <= 130 for file in files)
    assert all(file.startswith(10 * name) for file in files)


def test_a_file_may_have_the_longest_name(tmp_path):
    file = tmp_path / (85 * "速")  # 255 bytes
    write_output(file, lambda draft: draft.write_text("text"))
    assert [path.name for path in tmp_path.iterdir()] == [file.name]
