"""The claims under test: Sec. IV of the paper, and the gain from online adaptation."""

import numpy as np
import pytest

from trackslip.logs.logfile import read_runs
from trackslip.metrics import rms
from trackslip.trajectory.segmented import paper_reference

STICKIER_AT, ARC_END = 20.0, 33.8  # the ground called sticky; the end of the paper's arc [s]


def find(rows, **names):
    (row,) = [row for row in rows if all(row[key] == value for key, value in names.items())]
    return row


@pytest.mark.slow
def test_section_4_with_five_seeds(trackslip):
    rows = trackslip("benchmark", "--suite", "paper").summary["rows"]
    assert {row["seeds"] for row in rows} == {5}
    open_loop = [find(rows, controller="feedforward", compensation=name) for name in ("none", "icr_radius")]
    assert 1.2 < open_loop[0]["final_position"] < 1.6
    assert open_loop[1]["final_position"] < 0.04
    late, arc = (
        {row["compensation"]: row[key] for row in rows if (row["controller"], row["start"]) == ("linear", start)}
        for key, start in (("rms_position_after_12s", "paper"), ("rms_position_arc", "zero"))
    )
    assert late["icr_radius"] < 0.005
    assert late["icr_radius"] * 3.5 < late["none"]
    assert late["icr_radius"] < late["exponential"] < late["none"]
    assert late["published"] < late["none"]
    assert arc["icr_radius"] < 0.003
    for errors in (late, arc):
        assert errors["online"] < errors["icr_radius"] + 0.0005


@pytest.mark.slow
def test_on_ground_that_grows_stickier_online_adapts_within_seconds(trackslip):
    options = ("--controllers", "linear", "--references", "paper", "--grounds", "stone", "sticky", "--starts", "zero")
    options += ("--plants", "nominal", "--gains", "default")
    compensations = ("--compensations", "icr_radius", "online", "online_cold")
    result = trackslip("benchmark", *options, *compensations, "--seeds", "0", "1", "--jobs", "1")
    reference = paper_reference()
    for log in read_runs(result.folder / "runs.parquet"):
        error = np.hypot(*(log.truth.pose - reference.pose(log.time))[:, :2].T)
        adapted = rms(error[(log.time > STICKIER_AT + 5) & (log.time < ARC_END)])
        name, ground = log.metadata["compensation"], log.metadata["ground_name"]
        if (name, ground) == ("icr_radius", "sticky"):
            assert adapted > 0.015
        else:
            assert adapted < 0.004
        if name.startswith("online"):
            # what was driven in the last seconds of the arc, by commands that are known
            steady = (log.time > ARC_END - 5) & (log.time < ARC_END - 0.5)
            belts = log.omega[steady] * log.metadata["geometry"]["sprocket_radius"] * (1 + log.metadata["radius_error"])
            reach = np.mean(np.diff(belts, axis=1)) / np.mean(2 * log.truth.twist[steady, 2])
            true = reach - log.metadata["geometry"]["half_gauge"]
            late = log.time > STICKIER_AT + 8 if ground == "sticky" else log.time > 20.0
            np.testing.assert_allclose(log.icr[late, 0], true, rtol=0.05)
