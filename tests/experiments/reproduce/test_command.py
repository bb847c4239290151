import json

import numpy as np
import pytest
from bound import beside_bound
from command_runs import ran
from pages import ROOT, difference, shown

from trackslip.identification.samples import true_samples, usable_samples
from trackslip.laws.file import SHIPPED, load_laws
from trackslip.logs.logfile import read_runs
from trackslip.logs.runlog import stored_geometry
from trackslip.trajectory.segmented import paper_reference


@pytest.fixture(scope="module")
def reproduced(tmp_path_factory):
    """A whole reproduction, whose figures are not drawn."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("experiments.common.page.drawn_plot", lambda plot, pdf=False: ())
        return ran(tmp_path_factory.mktemp("reproduce") / "out", "reproduce")


@pytest.fixture(scope="module")
def summary(reproduced):
    return reproduced.summary


def grid_of(folder):
    return [log for log in read_runs(folder / "runs.parquet") if "radius" in log.metadata]


def slip_errors(folder, method):
    """Errors of slips (n, 2) of the runs on circles in a folder of results, by a motion method."""
    logs = grid_of(folder)
    geometry = stored_geometry(logs[0])
    return (
        usable_samples(logs, geometry, method=method, longest=True).samples.slip
        - true_samples(logs, geometry).slip
    )


def over_bound(logs):
    """Root mean square errors (3,) of measured x, y and heading over their Cramér-Rao bound, but
    for edge-on views.

    The scanner sees the plate: its true place on the leaning robot counts.
    """
    squares = np.zeros(3)
    bounds = np.zeros(3)
    for log in logs:
        phi = log.truth.pose[:, 2]
        left = np.column_stack([-np.sin(phi), np.cos(phi), np.zeros_like(phi)])
        plate = log.truth.pose + log.truth.lean[:, None] * left
        valid = np.flatnonzero(log.is_valid)[::5]
        error, bound = beside_bound(log.pose[valid], plate[valid], log.scans.plate, log.scans.scan)
        squares += np.sum(error**2, axis=0)
        bounds += np.einsum("sii->i", bound)
    return np.sqrt(squares / bounds)


def test_slips_and_radii_stand_beside_the_published(summary):
    assert summary["slip_rms_vs_published"] < 0.008
    assert summary["radius"]["rms_vs_published"] < 0.06
    np.testing.assert_allclose(summary["radius"]["published"], [0.62, 1.34, 2.05, 2.68, 3.12])
    np.testing.assert_allclose(
        summary["radius"]["observed"], summary["radius"]["published"], rtol=0.09
    )
    assert max(summary["speed_spread"].values()) < 0.003


def test_localization_and_slip_errors(reproduced, summary):
    found = summary["localization"]
    assert max(found["rmse_x"], found["rmse_y"]) < 0.004
    assert np.degrees(found["rmse_heading"]) < 0.4
    assert found["valid_fraction"] > 0.96  # the rest are edge-on views, which tell no heading
    assert found["rate_hz"] >= 10
    assert over_bound(grid_of(reproduced.folder)).max() < 1.1
    arc = slip_errors(reproduced.folder, "arc")
    bundle = slip_errors(reproduced.folder, "bundle")
    for errors, most in ((arc, 0.0004), (bundle, 0.0003)):
        assert errors.std(axis=0).max() < most
        assert np.abs(errors.mean(axis=0)).max() < 0.0002
    assert summary["slip_error"]["outer"]["std"] == pytest.approx(bundle[:, 1].std(), rel=1e-4)


def test_compensation_pays(summary):
    rows = {(row["controller"], row["compensation"]): row for row in summary["tracking"]}
    assert len(rows) == 10
    final = [
        rows["feedforward", law]["final_position"] for law in ("none", "exponential", "icr_radius")
    ]
    assert final[0] > final[1] > final[2]
    assert np.all(np.array(final) < [1.6, 0.35, 0.06])
    late = {
        law: rows["linear", law]["rms_position_after_12s"]
        for law in ("none", "exponential", "icr_radius")
    }
    assert late["none"] > 2.5 * late["exponential"]
    assert late["none"] > 2.5 * late["icr_radius"]


def test_the_law_that_fits_best_is_the_physics(summary):
    errors = {name: law["rms"] for name, law in summary["laws"].items()}
    assert errors["icr_radius"] < min(errors["icr"], errors["exponential"])
    values = summary["slip_laws"]["icr_radius"]["values"]
    assert values["radius_error"] == pytest.approx(0.0067, abs=0.0006)


def test_the_shipped_laws_are_these(summary):
    stored = json.loads(SHIPPED.read_text())
    for name in load_laws(SHIPPED):
        fresh = summary["slip_laws"][name]
        for key, value in stored["slip_laws"][name]["values"].items():
            assert value == pytest.approx(fresh["values"][key], abs=0.2 * fresh["stderr"][key])


def test_what_is_left_behind(reproduced, summary):
    # and figures, which these tests don't draw
    files = {"manifest.json", "summary.json", "runs.parquet", "report.html"}
    assert {path.name for path in reproduced.folder.iterdir()} == files
    simulated = 25 * 30 + 10 * paper_reference().duration
    assert summary["timing"]["simulated_s"] == pytest.approx(simulated, abs=1)
    manifest = reproduced.manifest
    assert manifest["config"]["duration"] == 30
    assert manifest["config"]["scanner"]["noise"] == 0.005
    assert manifest["versions"]["mujoco"] >= "4.0"
    assert len(manifest["model_sha256"]) == 64


def test_the_pages_show_what_is_printed(reproduced):
    page = ROOT / "docs" / "reproduction.md"
    for text in (
        shown(ROOT / "README.md", "slip law"),
        shown(page, "slip law"),
        shown(page, "Tracking errors"),
    ):
        assert difference(text, reproduced.printed) is None


@pytest.mark.slow
@pytest.mark.parametrize(
    "options", [(), ("--random-phase",), ("--random-phase", "--scanner.noise", "0.01")]
)
def test_slip_error_over_seeds(tmp_path, options):
    """125 runs, starting nearest to the scanner or at random phases."""
    bounds = {"bundle": 0.0003, "arc": 0.0004}
    if "0.01" in options:
        bounds = {"bundle": 0.0005}
    results = [ran(tmp_path / str(k), "grid", "--seed", str(k), *options) for k in range(5)]
    for method, most in bounds.items():
        errors = np.array([slip_errors(result.folder, method) for result in results])
        assert errors.std(axis=1).max() < most
        assert np.abs(errors.mean(axis=1)).max() < 0.0002
    assert max(over_bound(grid_of(result.folder)).max() for result in results) < 1.1
