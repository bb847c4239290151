import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from slip_data import GEOMETRY

import sim
import trackslip
from trackslip.kinematics import advance

ROOT = Path(trackslip.__file__).parents[1]
LAW = trackslip.ConstantIcr(0.045, GEOMETRY.half_gauge, 0.0067)


def modules_after(statement):
    code = f"import sys\nbefore = set(sys.modules)\n{statement}\nprint(*sorted(set(sys.modules) - before))"
    return set(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split())


def steady_run(radius, speed=0.2, duration=12.0, metadata=None):
    twist = np.array([speed, speed / radius])
    time = np.arange(0, duration, 0.05)
    noise = np.random.default_rng([round(1000 * radius), round(1000 * speed)]).normal(0, 0.002, (time.size, 3))
    pose = advance([0.0, 0.0, 0.0], twist, time) + noise
    omega = np.tile(LAW.sprocket_speeds(twist, GEOMETRY), (time.size, 1))
    return trackslip.RunLog(f"R{radius:g}_v{speed:g}", time, omega, pose, metadata=metadata or {})


@pytest.fixture(scope="module")
def runs():
    return [steady_run(radius, speed) for radius in (0.6, 0.9, 1.3, 2.0, 3.0) for speed in (0.1, 0.2)]


@pytest.fixture(scope="module")
def found(runs):
    return trackslip.identify(runs, GEOMETRY)


@pytest.mark.parametrize(("package", "some"), [(trackslip, "identify"), (sim, "Fleet")])
def test_every_public_name_is_there(package, some):
    assert some in package.__all__
    assert set(package.__all__) <= {*dir(package), "__version__"}
    assert all(getattr(package, name) is not None for name in package.__all__)
    with pytest.raises(AttributeError, match="nonsense"):
        _ = package.nonsense


def test_importing_the_package_imports_next_to_nothing():
    found = modules_after("import trackslip")
    assert {name for name in found if name.startswith("trackslip")} == {"trackslip"}
    assert not found & {"numpy", "scipy", "typing", "dataclasses", "pathlib"}


def test_runs_in_memory_in_a_folder_and_in_a_file_give_the_same_laws(runs, found, tmp_path):
    from trackslip.logs.logfile import RUNS, write_csv, write_parquet

    write_parquet(runs, tmp_path / RUNS)
    write_csv(runs, tmp_path / "log.csv")
    assert found.best == "icr_radius"
    for source in (tmp_path, str(tmp_path / "log.csv")):
        assert trackslip.identify(source, GEOMETRY).laws == found.laws


def test_intervals_cover_the_law_that_was_driven(found):
    for name, (low, high) in found.intervals["icr_radius"].items():
        assert low < getattr(LAW, name) < high
    assert set(found.intervals) == set(found.laws)


def test_geometry_comes_from_the_log_or_is_asked_for(runs, found):
    stated = {"geometry": {"half_gauge": GEOMETRY.half_gauge, "sprocket_radius": GEOMETRY.sprocket_radius}}
    told = [steady_run(radius, metadata=stated) for radius in (0.6, 1.0, 2.0, 3.0)]
    assert trackslip.identify(told).geometry == GEOMETRY
    with pytest.raises(trackslip.InvalidValueError, match=r"half_gauge = None: must be given .*the runs"):
        trackslip.identify(runs)


def test_nothing_to_identify_from_is_refused():
    with pytest.raises(trackslip.LogError, match=r"the runs: there are none"):
        trackslip.identify([], GEOMETRY)
    closed_loop = [steady_run(1.0, metadata={"controller": "linear"})]
    with pytest.raises(trackslip.LogError, match=r"1 run in closed loop"):
        trackslip.identify(closed_loop, GEOMETRY, method="steady")


def test_an_identification_shows_its_best_laws(found):
    lines = repr(found).splitlines()
    assert lines[0] == "Slip laws from 10 steady samples (b = 0.168 m, r = 0.06 m); best: icr_radius"
    assert lines[2].split()[:4] == ["icr_radius", "(best)", "offset", "[m]"]
    values = found.comparison.laws["icr_radius"].values
    assert float(lines[2].split()[4]) == pytest.approx(values["offset"], abs=1e-5)
    low, high = (float(lines[2].split()[k]) for k in (5, 7))
    assert (low, high) == pytest.approx(found.intervals["icr_radius"]["offset"], abs=1e-5)
    assert len(lines) < 20
    html = found._repr_html_()
    for law in found.laws.values():
        assert type(law).__name__ == "NoSlip" or html.count("<tr>") > 10
    assert html.count("<tr>") == 1 + sum(len(fit.values) for fit in found.comparison.laws.values())


def install(tmp_path, monkeypatch, entry_point):
    """Put a distribution with an entry point for reports before all others."""
    about = tmp_path / "drawer-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: drawer\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(f"[trackslip.reports]\nidentification = {entry_point}\n")
    monkeypatch.syspath_prepend(tmp_path)


def test_reports_are_drawn_by_whoever_offers_to(found, tmp_path, monkeypatch):
    entry_point = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]["trackslip.reports"]
    install(tmp_path, monkeypatch, entry_point["identification"])
    file = found.report(tmp_path)
    assert file == tmp_path / "report.html"
    html = file.read_text()
    assert html.startswith("<!DOCTYPE html>")
    assert ">best</span>" in html
    assert str(tmp_path) not in html


def test_without_a_drawer_or_a_place_the_report_is_refused(found, tmp_path, monkeypatch):
    with monkeypatch.context() as nothing:
        nothing.setattr(sys, "path", [])
        with pytest.raises(trackslip.TrackslipError, match=r"no package .* 'trackslip.reports' is installed"):
            found.report(tmp_path / "report.html")
    install(tmp_path, monkeypatch, "builtins:repr")
    with pytest.raises(trackslip.OutputError, match="No such file"):
        found.report(tmp_path / "nowhere" / "report.html")


def test_laws_are_saved_and_loaded(found, tmp_path):
    file = tmp_path / "laws.json"
    trackslip.save_laws(file, found.laws, GEOMETRY)
    named = {name: law for name, law in found.laws.items() if name != "none"}
    assert trackslip.load_laws(file, GEOMETRY) == named
    assert set(json.loads(file.read_text())["slip_laws"]) == set(named)
    with pytest.raises(trackslip.InvalidValueError, match="law = 'mine': must be one of"):
        trackslip.save_laws(file, {"mine": LAW}, GEOMETRY)
    with pytest.raises(trackslip.InvalidValueError, match="a law of the family 'icr'"):
        trackslip.save_laws(file, {"icr": LAW}, GEOMETRY)
    with pytest.raises(trackslip.OutputError, match="cannot be written"):
        trackslip.save_laws(tmp_path / "nowhere" / "laws.json", found.laws, GEOMETRY)


def test_extras_are_installed_from_a_checkout():
    """No index has a distribution called trackslip: messages and docs install it, and only extras that there are."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    folders = ("trackslip", "sim", "experiments", "docs", "examples")
    files = [file for folder in folders for kind in ("py", "md") for file in (ROOT / folder).rglob(f"*.{kind}")]
    text = "\n".join(file.read_text() for file in (*files, ROOT / "README.md"))
    assert not re.findall(r"trackslip\[[a-z,]+\]", text)
    named = {name for listed in re.findall(r'pip install -e "\.\[([a-z,]+)\]"', text) for name in listed.split(",")}
    assert {"mpc", "rl", "dask", "ros"} <= named <= extras.keys()
