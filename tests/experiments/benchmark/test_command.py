import re

import numpy as np
import pytest

from trackslip.logs.logfile import read_runs
from trackslip.metrics import rms, tracking_errors
from trackslip.replacement import STORE
from trackslip.trajectory.named import load_reference
from trackslip.trajectory.segmented import paper_reference

MODULE = """
import numpy as np
from trackslip.controllers.feedback import LinearTimeVarying

class Late(LinearTimeVarying):
    def twist(self, time, pose, reference):
        return super().twist(time, pose, reference) * (np.nan if time > 2.0 else 1.0)

class Broken(LinearTimeVarying):
    def reset(self):
        raise RuntimeError("out of order")

class Careless(LinearTimeVarying):
    def twist(self, time, pose, reference):
        twist = super().twist(time, pose, reference)
        pose += 1.0
        return twist
"""
ALONE = (
    "--compensations",
    "none",
    "--grounds",
    "stone",
    "--plants",
    "nominal",
    "--gains",
    "default",
)


@pytest.mark.usefixtures("with_figures")
def test_rows_are_what_the_stored_runs_say(trackslip, short):
    options = ("--controllers", "linear", "--compensations", "none", "online", "--seeds", "0", "3")
    options += ("--plants", "nominal")
    result = trackslip("benchmark", *short, *options, "--grounds", "stone", "gravel")
    rows = result.summary["rows"]
    logs = {log.run: log for log in read_runs(result.folder / "runs.parquet")}
    assert len(rows) == 2 * 2
    assert len(logs) == result.summary["runs"] == 8
    assert result.summary["failures"] == []
    reference = load_reference("bend.csv")
    for row in rows:
        case = [
            row[name] for name in ("controller", "compensation", "reference", "ground", "start")
        ]
        errors = []
        for seed in (0, 3):
            log = logs[" ".join([*case, str(seed)])]
            assert log.metadata["seed"] == seed
            assert (
                log.metadata["ground"]["across"] == {"stone": 0.778, "gravel": 0.455}[row["ground"]]
            )
            assert (log.icr is not None) == (row["compensation"] == "online")
            errors.append(tracking_errors(log.time, log.truth.pose, reference))
        for key in (
            "rms_position",
            "rms_position_after_12s",
            "rms_position_arc",
            "rms_heading",
            "cross_track",
        ):
            assert row[key] == pytest.approx(np.mean([getattr(e, key) for e in errors]))
        assert (row["seeds"], row["failed"], row["success"], row["valid_fraction"]) == (
            2,
            0,
            1.0,
            1.0,
        )
    page = (result.folder / "report.html").read_text(encoding="utf-8")
    best = result.summary["board"][0]
    for text in (page, result.printed):
        entry = f"{best['controller']} controller, {best['compensation']} compensation"
        assert f"Best: {entry}: {1e3 * best['score']:.1f} mm rms" in text
    assert '<th scope="col" class="r">improvement ×</th>' in page
    names = {path.stem for path in (result.folder / "figures").glob("*.svg")}
    assert {"leaderboard"} == names == set(re.findall(r'<figure id="(\w+)"', page))
    assert not (result.folder / STORE).exists()


def test_the_ground_robot_is_the_one_in_the_robots_file(trackslip, short, tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("half_gauge = 0.2\n[ground]\nalong = 0.41\nacross = 0.43\n")
    chosen = ("--controllers", "linear", "--seeds", "0", "--grounds", "robot", "stone")
    options = (*ALONE, *chosen, "--robot", str(file))
    result = trackslip("benchmark", *short, *options)
    logs = read_runs(result.folder / "runs.parquet")
    along = [log.metadata["ground"]["along"] for log in logs]
    assert along == [0.41, 0.7]


def test_controllers_that_misbehave_fail_alone(trackslip, short, tmp_path):
    """Other runs of the fleet are unaffected, even by a controller that overwrites the poses it is
    given.
    """
    (tmp_path / "mine.py").write_text(MODULE)
    broken = {
        "mine:Broken": "its controller fails at 0 s (RuntimeError: out of order), mine.py line 11",
        "mine:Late": "returns the twist (nan, nan) at 2.05 s: must be finite",
    }
    controllers = ("--controllers", "linear", "mine:Careless", *broken)
    result = trackslip("benchmark", *short, *ALONE, "--seeds", "0", "1", *controllers)
    rows = {row["controller"]: row for row in result.summary["rows"]}
    assert rows["mine:Careless"]["rms_position"] == rows["linear"]["rms_position"]
    for name, message in broken.items():
        assert (rows[name]["failed"], rows[name]["rms_position"], rows[name]["success"]) == (
            2,
            None,
            0,
        )
        reasons = [
            failure["error"]
            for failure in result.summary["failures"]
            if failure["run"].startswith(name)
        ]
        assert len(reasons) == 2
        assert message in reasons[0]
        assert message in result.printed
    assert len(read_runs(result.folder / "runs.parquet")) == 2 * 2


STICKIER_AT = 20.0  # of the ground called sticky [s]
ARC_END = 33.8  # the end of the paper's arc [s]


@pytest.mark.slow
def test_section_4_with_five_seeds(trackslip):
    rows = trackslip("benchmark", "--suite", "paper").summary["rows"]
    assert {row["seeds"] for row in rows} == {5}
    final = {
        row["compensation"]: row["final_position"]
        for row in rows
        if row["controller"] == "feedforward"
    }
    assert 1.2 < final["none"] < 1.6
    assert final["icr_radius"] < 0.04
    linear = [row for row in rows if row["controller"] == "linear"]
    late = {
        row["compensation"]: row["rms_position_after_12s"]
        for row in linear
        if row["start"] == "paper"
    }
    arc = {row["compensation"]: row["rms_position_arc"] for row in linear if row["start"] == "zero"}
    assert late["icr_radius"] < 0.005
    assert late["icr_radius"] * 3.5 < late["none"]
    assert late["icr_radius"] < late["exponential"] < late["none"]
    assert late["published"] < late["none"]
    assert arc["icr_radius"] < 0.003
    for errors in (late, arc):
        assert errors["online"] < errors["icr_radius"] + 0.0005


@pytest.mark.slow
def test_online_adapts_to_stickier_ground_within_seconds(trackslip):
    options = (
        "--controllers",
        "linear",
        "--references",
        "paper",
        "--grounds",
        "stone",
        "sticky",
        "--starts",
        "zero",
    )
    options += ("--plants", "nominal", "--gains", "default", "--seeds", "0", "1", "--jobs", "1")
    result = trackslip(
        "benchmark", *options, "--compensations", "icr_radius", "online", "online_cold"
    )
    for log in read_runs(result.folder / "runs.parquet"):
        error = np.hypot(*(log.truth.pose - paper_reference().pose(log.time))[:, :2].T)
        adapted = rms(error[(log.time > STICKIER_AT + 5) & (log.time < ARC_END)])
        if (log.metadata["compensation"], log.metadata["ground_name"]) == ("icr_radius", "sticky"):
            assert adapted > 0.015
        else:
            assert adapted < 0.004
