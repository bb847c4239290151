"""Runs with their recordings."""

from pathlib import Path

import pytest
from rrd import CIRCLE

from experiments.cli import main
from trackslip.logs.logfile import read_runs
from trackslip.logs.runlog import RunLog


@pytest.fixture(scope="session")
def driven(tmp_path_factory) -> tuple[Path, list[RunLog]]:
    """Two runs on a circle among posts, whose folders hold a recording each."""
    logs, folder = [], tmp_path_factory.mktemp("recording")
    for compensation in ("none", "icr_radius"):
        out = folder / compensation
        main(["track", *CIRCLE, "--compensation", compensation, "--obstacles", "posts", "--rrd", "--out", str(out)])
        logs += read_runs(out / "runs.parquet")
    return folder, logs
