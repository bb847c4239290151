"""The claims under test: Sec. IV of the paper, and the gain from online adaptation."""

import numpy as np
import pytest

from trackslip.logs.logfile import read_runs
from trackslip.metrics import rms
from trackslip.trajectory.segmented import paper_reference

STICKIER_AT, ARC_END = 20.0, 33.8  # the ground called sticky; the end of the paper's arc [s]


@pytest.mark.slow
def test_section_4_with_five_seeds(trackslip):
    rows = trackslip("benchmark", "--suite", "paper").summary["rows"]
    assert {row["seeds"] for row in rows} == {5}
    final = {row["compensation"]: row["final_position"] for row in rows if row["controller"] == "feedforward"}
    assert 1.2 < final["none"] < 1.6
    assert final["icr_radius"] < 0.04
    linear = [row for row in rows if row["controller"] == "linear"]
    late = {row["compensation"]: row["rms_position_after_12s"] for row in linear if row["start"] == "paper"}
    arc = {row["compensation"]: row["rms_position_arc"] for row in linear if row["start"] == "zero"}
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
    options += ("--plants", "nominal", "--gains", "default", "--seeds", "0", "1", "--jobs", "1")
    result = trackslip("benchmark", *options, "--compensations", "icr_radius", "online", "online_cold")
    for log in read_runs(result.folder / "runs.parquet"):
        error = np.hypot(*(log.truth.pose - paper_reference().pose(log.time))[:, :2].T)
        adapted = rms(error[(log.time > STICKIER_AT + 5) & (log.time < ARC_END)])
        if (log.metadata["compensation"], log.metadata["ground_name"]) == ("icr_radius", "sticky"):
            assert adapted > 0.015
        else:
            assert adapted < 0.004
