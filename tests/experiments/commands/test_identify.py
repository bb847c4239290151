"""`trackslip identify`: steady samples, bad logs, and runs of other commands."""

import numpy as np
import pytest

GEOMETRY = ("--half-gauge", "0.168", "--sprocket-radius", "0.06")
TRACE = "run,t,omega_l,omega_r,x,y,phi\n" + "".join(f"a,{k / 20},2,3,{k / 100},0,0\n" for k in range(200))


@pytest.mark.usefixtures("few_resamples")
def test_steady_samples_of_a_real_robot(trackslip, tmp_path):
    twist = np.column_stack([np.full(6, 0.2), 0.2 * np.array([1.5, 0.8, 0.4, -0.5, -1.0, 0.1])])
    surface = twist[:, :1] + np.array([-1, 1]) * (0.3 + 0.06) * twist[:, 1:]
    table = np.column_stack([surface / 0.08, twist])
    rows = "\n".join(",".join(map(repr, map(float, row))) for row in table)
    (tmp_path / "samples.csv").write_text("omega_l,omega_r,v,w\n" + rows)
    result = trackslip("identify", str(tmp_path / "samples.csv"), "--half-gauge", "0.3", "--sprocket-radius", "0.08")
    assert result.summary["slip_laws"]["icr"]["values"]["offset"] == pytest.approx(0.06)
    assert result.summary["samples"] == 6
    assert (result.folder / "runs.parquet").is_file()


@pytest.mark.usefixtures("few_resamples")
def test_laws_whose_fit_ends_at_a_limit_are_told_of(trackslip, tmp_path):
    rows = "".join(f"{3 - k / 2},{3 + k / 2},0.2,{0.07 * k}\n" for k in (1, -1, 2, -2, 3, 4))
    (tmp_path / "samples.csv").write_text("omega_l,omega_r,v,w\n" + rows)
    result = trackslip("identify", str(tmp_path / "samples.csv"), "--half-gauge", "0.3", "--sprocket-radius", "0.08")
    assert any(
        "law exponential: the 6 samples don't determine alpha_inner (the fit stopped at -19.9)" in line
        for line in result.summary["warnings"]
    )


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        (TRACE, (), "half_gauge = None: must be given (--half-gauge"),
        (
            TRACE.replace(",2,", ",inf,"),
            GEOMETRY,
            "run 'a': row 1, column omega_l: 'inf' is not a finite number",
        ),
        (TRACE.replace(",0,0\n", ",oops,0\n"), GEOMETRY, "run 'a': row 1, column y: 'oops' is not a finite number"),
        (TRACE.replace(",0,0\n", ",0,\n"), (*GEOMETRY, "--method", "steady"), "run 'a': has no headings"),
        (TRACE.replace("omega_r", "omega_right"), GEOMETRY, "column omega_r is missing"),
        ("a,b\n1,2\n", GEOMETRY, "needs the columns"),
        (TRACE.replace(",", ";"), GEOMETRY, "must be separated by commas"),
        (TRACE.replace(",", ";").replace(".", ","), GEOMETRY, "must be separated by commas"),
        ("omega_l,omega_r,v,w\n1,2,0.1,x\n", GEOMETRY, "run 'row 1': column w: 'x' is not a finite number"),
        ("omega_l,omega_r,v,w\n0,0,0.1,0.2\n", GEOMETRY, "run 'row 1': the sprockets stand still"),
        ("omega_l,omega_r,v,w\n1,1,0.06,0\n", GEOMETRY, "determine"),
        (TRACE[: TRACE.index("a,1.0")], (*GEOMETRY, "--method", "steady"), "too short"),
    ],
)
def test_bad_logs_get_one_line(refused, tmp_path, text, options, message):
    path = tmp_path / "log.csv"
    path.write_text(text)
    assert message in refused("identify", str(path), *options)
