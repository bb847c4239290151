"""Benchmarks that are killed or interrupted, and what is kept of them."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pyarrow.parquet

from experiments.benchmark.cases import Case, identified
from experiments.benchmark.drive import ClosedLoops
from experiments.commands.benchmark import PARTS, Config
from experiments.storage.manifest import digest, made_by
from experiments.sweep.engine import drive_fleet

SMALL = ("--controllers", "feedforward", "linear", "--compensations", "none", "online", "--grounds", "stone", "gravel")
ROOT = Path(__file__).parents[3]
WAITS = '''
import pathlib, time
from trackslip.controllers.linear import LinearTimeVarying

class Waits(LinearTimeVarying):
    """Hangs on the path that ends 0.6 m ahead, which is driven last, as long as there is a file called wait."""
    def twist(self, now, pose, reference):
        while reference.pose(reference.duration)[0] < 0.7 and pathlib.Path("wait").exists():
            time.sleep(0.01)
        return super().twist(now, pose, reference)
'''


def test_a_killed_benchmark_resumes(trackslip, short, tmp_path, monkeypatch):
    """The fleet that was finished isn't driven again, and the results are those of one that was not disturbed."""
    (tmp_path / "turn.csv").write_text("x,y\n0,0\n0.4,-0.1\n0.8,-0.3\n1.0,-0.6\n")
    (tmp_path / "waits.py").write_text(WAITS)
    (tmp_path / "wait").touch()
    options = [*short[:2], "turn.csv", *short[2:], "--controllers", "waits:Waits", "linear", "--compensations", "none"]
    command = ["benchmark", *options, "--grounds", "stone", "--seeds", "0"]
    parts = tmp_path / "killed" / PARTS
    process = subprocess.Popen(
        [sys.executable, "-m", "experiments", *command, "--out", "killed"],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.DEVNULL,
    )
    while not list(parts.glob("*.json")):
        assert process.poll() is None
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert len(list(parts.glob("*.json"))) == 1
    assert not (tmp_path / "killed" / "summary.json").exists()
    (tmp_path / "wait").unlink()
    driven = []

    def counted(kind, cases, **options):
        driven.extend(case.reference for case in cases)
        return drive_fleet(kind, cases, **options)

    monkeypatch.setattr("experiments.sweep.engine.drive_fleet", counted)
    killed, undisturbed = (trackslip(*command, "--out", str(tmp_path / name)) for name in ("killed", "undisturbed"))
    assert driven[:2] == ["bend.csv"] * 2
    assert len(driven) == 2 + 4
    tables = [pyarrow.parquet.read_table(one.folder / "runs.parquet") for one in (killed, undisturbed)]
    assert tables[0].equals(tables[1], check_metadata=True)
    assert killed.summary["cases"] == undisturbed.summary["cases"]


def test_parts_of_another_benchmark_are_left_but_not_those_of_other_code(trackslip, short, tmp_path):
    folder = tmp_path / "benchmark" / PARTS
    folder.mkdir(parents=True)
    row = {"run": "a run", "id": "its id", "error": None}
    for name, now in (("0123", made_by()), ("4567", made_by() | {"code": "other"})):
        (folder / f"{name}.parquet").touch()
        content = {"made_by": {digest(now): now}, "runs": [row | {"made_by": digest(now)}]}
        (folder / f"{name}.json").write_text(json.dumps(content))
    (folder / ".89ab.json-99").touch()  # a draft of a killed command
    (folder / "cdef.json").write_text("{}")
    trackslip("benchmark", *short, *SMALL[:2], "--compensations", "none", "--grounds", "stone", "--seeds", "0")
    assert {file.name for file in folder.iterdir()} == {"0123.json", "0123.parquet"}


def test_parts_depend_on_what_a_users_modules_say(tmp_path, short, monkeypatch):
    (tmp_path / "gains_of_mine.py").write_text("K = 1.0")
    source = "import gains_of_mine\nfrom trackslip.controllers.linear import LinearTimeVarying as Mine"
    (tmp_path / "imports_gains.py").write_text(source)
    loops = ClosedLoops(Config(localization="truth"))
    cases = (Case("imports_gains:Mine", "none", "bend.csv", "stone", "zero", 0),)
    loops.check(cases)
    before = identified(cases, loops.config, loops.world)
    (tmp_path / "gains_of_mine.py").write_text("K = 2.0")
    assert identified(cases, loops.config, loops.world) != before
