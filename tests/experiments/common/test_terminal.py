import os
import signal
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import pytest
from drives import SLAM, drive_log

from experiments.cli import main
from experiments.common.temporary import temporary_files
from trackslip.logs.logfile import write_csv, write_parquet

NAME = "a\x1b]0;owned\x07\x1b[2J\x9b1m"


@pytest.fixture(params=[write_parquet, write_csv])
def log(request, tmp_path):
    log = replace(drive_log(0, 6.0, SLAM), run=NAME)
    damaged = replace(log, run=f"{NAME} b", omega=0 * log.omega)
    file = tmp_path / ("log.parquet" if request.param is write_parquet else "log.csv")
    request.param([log, damaged], file)
    return file


@pytest.mark.parametrize(
    "command",
    [
        "log {log}",
        "view {log} --save {out}.rrd",
        "identify {log} --half-gauge 0.168 --sprocket-radius 0.06 --out {out} --all",
    ],
)
def test_names_in_files_cannot_control_the_terminal(log, command, tmp_path, capsys):
    main(command.format(log=log, out=tmp_path / "out").split())
    printed = capsys.readouterr()
    for text in printed:
        assert all(c.isprintable() or c == "\n" for c in text)


def test_temporary_files_are_private_and_deleted():
    with temporary_files() as folder:
        assert folder.stat().st_mode & 0o077 == 0
        assert Path(tempfile.mkdtemp()).parent == folder
        assert os.environ["TMPDIR"] == str(folder)
    assert not folder.exists()
    assert Path(tempfile.gettempdir()) == folder.parent


def test_files_of_a_killed_process_are_deleted_later():
    code = "from experiments.common.temporary import temporary_files\nimport time\n"
    code += "with temporary_files() as folder:\n print(folder, flush=True)\n time.sleep(60)"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as left:
        folder = Path(left.stdout.readline().strip())
        with temporary_files():
            assert folder.exists()  # of a running process
        left.send_signal(signal.SIGKILL)
    assert folder.exists()
    with temporary_files():
        assert not folder.exists()
