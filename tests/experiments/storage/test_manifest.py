"""What reproduces a result, without the machine's folders."""

import json

from experiments.storage.manifest import relative


def test_paths_are_relative_to_the_current_folder(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    for text, expected in (
        (str(tmp_path / "here" / "out"), "out"),
        (str(tmp_path / "laws.json"), "../laws.json"),
        (f"ppo:{tmp_path}/here/policy.npz", "ppo:policy.npz"),
        (f"--out={tmp_path}/here/out", "--out=out"),
        (f"ground={tmp_path}/ice.toml", "ground=../ice.toml"),
        ("out/grid", "out/grid"),
        ("dask://10.0.0.1:8786", "dask://10.0.0.1:8786"),
        ("mine:Controller", "mine:Controller"),
        ("ice", "ice"),
    ):
        assert relative(text) == expected


def test_results_say_nothing_about_the_machines_folders(trackslip, tmp_path, monkeypatch):
    """Neither of where they are nor of where files are that were given by absolute paths."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bend.csv").write_text("x,y\n0,0\n0.3,0.05\n0.6,0.2\n")
    (tmp_path / "ground.toml").write_text("along = 0.5\nacross = 0.6\n")
    arguments = [
        *("benchmark", "--controllers", "feedforward", "--compensations", "none", "--starts", "zero", "--seeds", "0"),
        *("--references", str(tmp_path / "bend.csv"), "--grounds", str(tmp_path / "ground.toml"), "--jobs", "1"),
        *("--localization", "truth", "--out", str(tmp_path / "out")),
    ]
    monkeypatch.setattr("sys.argv", ["trackslip", *arguments])
    result = trackslip(*arguments)
    assert result.manifest["config"]["out"] == "out"
    assert result.manifest["config"]["references"] == ["bend.csv"]
    assert result.manifest["arguments"][-1] == "out"
    assert list(result.manifest["ground"]) == ["ground.toml"]
    assert str(tmp_path) not in json.dumps(result.manifest)
    assert str(tmp_path) not in (result.folder / "report.html").read_text(encoding="utf-8")
