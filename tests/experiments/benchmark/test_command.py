"""`trackslip benchmark`: rows match the stored runs, and faulty controllers fail alone."""

import re

import numpy as np
import pytest

from experiments.common.sweep import STORE
from trackslip.logs.logfile import read_runs
from trackslip.metrics import tracking_errors
from trackslip.trajectory.named import load_reference

MODULE = """
import numpy as np
from trackslip.controllers.error_feedback import LinearTimeVarying

class Late(LinearTimeVarying):
    def twist(self, time, pose, reference):
        return super().twist(time, pose, reference) * (np.nan if time > 2.0 else 1.0)

class Broken(LinearTimeVarying):
    def twist(self, time, pose, reference):
        raise RuntimeError("out of order")

class Quits(LinearTimeVarying):
    def twist(self, time, pose, reference):
        raise SystemExit("enough")

class Careless(LinearTimeVarying):
    def twist(self, time, pose, reference):
        twist = super().twist(time, pose, reference)
        pose += 1.0
        return twist
"""
ALONE = ("--compensations", "none", "--grounds", "stone", "--plants", "nominal", "--gains", "default")


@pytest.mark.usefixtures("with_figures")
def test_rows_are_what_the_stored_runs_say(trackslip, short):
    options = ("--controllers", "feedforward", "linear", "--compensations", "none", "online", "--seeds", "0", "3")
    options += ("--plants", "nominal")
    result = trackslip("benchmark", *short, *options, "--grounds", "stone", "gravel")
    rows, logs = result.summary["rows"], {log.run: log for log in read_runs(result.folder / "runs.parquet")}
    assert len(rows) == 2 * 2 * 2
    assert len(logs) == result.summary["runs"] == 16
    assert result.summary["failures"] == []
    reference = load_reference("bend.csv")
    for row in rows:
        case = [row[name] for name in ("controller", "compensation", "reference", "ground", "start")]
        errors = []
        for seed in (0, 3):
            log = logs[" ".join([*case, str(seed)])]
            assert log.metadata["seed"] == seed
            assert log.metadata["ground"]["across"] == {"stone": 0.778, "gravel": 0.455}[row["ground"]]
            assert (log.icr is not None) == (row["compensation"] == "online")
            errors.append(tracking_errors(log.time, log.truth.pose, reference))
        for key in (
            "rms_position",
            "rms_position_after_12s",
            "rms_position_arc",
            "rms_heading",
            "cross_track",
            "along_track",
            "iae",
            "itae",
        ):
            assert row[key] == pytest.approx(np.mean([getattr(e, key) for e in errors]))
        assert (row["seeds"], row["failed"], row["success"], row["valid_fraction"]) == (2, 0, 1.0, 1.0)
    page = (result.folder / "report.html").read_text(encoding="utf-8")
    best = result.summary["board"][0]
    for text in (page, result.printed):
        assert f"Best: {best['controller']} with {best['compensation']}, {1e3 * best['score']:.1f} mm" in text
    names = {path.stem for path in (result.folder / "figures").glob("*.svg")}
    assert {"leaderboard"} == names == set(re.findall(r'<figure id="(\w+)"', page))
    assert not (result.folder / STORE).exists()


def test_controllers_that_misbehave_fail_alone(trackslip, short, tmp_path):
    """Other runs of the fleet are unaffected, even by a controller that overwrites the poses it is given."""
    (tmp_path / "mine.py").write_text(MODULE)
    broken = {
        "mine:Broken": "its controller fails at 0 s (RuntimeError: out of order), mine.py line 11",
        "mine:Quits": "SystemExit: enough",
        "mine:Late": "returns the twist (nan, nan) at 2.05 s: must be finite",
    }
    controllers = ("--controllers", "linear", "mine:Careless", *broken)
    result = trackslip("benchmark", *short, *ALONE, "--seeds", "0", "1", *controllers)
    rows = {row["controller"]: row for row in result.summary["rows"]}
    assert rows["mine:Careless"]["rms_position"] == rows["linear"]["rms_position"]
    for name, message in broken.items():
        assert (rows[name]["failed"], rows[name]["rms_position"], rows[name]["success"]) == (2, None, 0)
        reasons = [failure["error"] for failure in result.summary["failures"] if failure["run"].startswith(name)]
        assert len(reasons) == 2
        assert message in reasons[0]
        assert message in result.printed
    assert len(read_runs(result.folder / "runs.parquet")) == 2 * 2


def test_when_every_run_fails_there_is_still_a_table(trackslip, short, tmp_path):
    (tmp_path / "mine3.py").write_text(MODULE)
    result = trackslip("benchmark", *short, *ALONE, "--controllers", "mine3:Broken", "--seeds", "0")
    assert [row["failed"] for row in result.summary["rows"]] == [1]
    assert not (result.folder / "runs.parquet").exists()
    assert result.printed.startswith("No entry keeps the path.")
