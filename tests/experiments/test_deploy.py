import json

import pytest
from deployed import stored
from plain_drives import identified_from, wandered

import trackslip
from experiments.cli import main
from trackslip.deploy.deploy import TARGETS
from trackslip.identification.result import identification_to_json


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    found = identified_from(wandered(duration=65.0), names=("none", "icr_radius"))
    folder = tmp_path_factory.mktemp("results") / "mine"
    folder.mkdir()
    (folder / "summary.json").write_text(json.dumps(identification_to_json(found)))
    return folder


@pytest.mark.parametrize("to", TARGETS)
def test_it_prints_what_it_writes(to, identified, tmp_path, capsys):
    main(["deploy", str(identified), "--to", to])
    printed = capsys.readouterr().out
    assert printed == trackslip.deploy_law(identified, to)
    main(["deploy", str(identified), "--to", to, "--out", str(tmp_path / "law")])
    assert capsys.readouterr().out == f"{tmp_path / 'law'}: written for {to}, law icr_radius\n"
    assert (tmp_path / "law").read_text() == printed


def test_a_law_that_is_not_the_best_is_told(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    content = dict(stored(best="turn_loss", expressible="icr").content)
    (tmp_path / "laws.json").write_text(json.dumps(content))
    main(["deploy", "laws.json", "--out", "drive.yaml"])
    told = capsys.readouterr().out.splitlines()[-1]
    assert told == "warning: exported icr, not the best law (turn_loss)"


def test_a_file_is_not_replaced_unasked(refused, tmp_path):
    (tmp_path / "laws.json").write_text(json.dumps(dict(stored().content)))
    line = refused("deploy", "laws.json", "--law", "icr", "--out", "laws.json")
    assert "laws.json: exists already, with other content; --overwrite replaces it" in line


def test_a_law_with_an_alarm_is_refused_unless_the_user_accepts(refused, tmp_path, capsys):
    content = dict(
        stored(best="icr", alarms=[{"kind": "blocks", "line": "3 parts are too few"}]).content
    )
    (tmp_path / "laws.json").write_text(json.dumps(content))
    said = "law icr: ALARM 3 parts are too few: --accept deploys it all the same"
    for to in TARGETS:
        assert said in refused("deploy", "laws.json", "--to", to)
    main(["deploy", "laws.json", "--accept"])
    assert "# ALARM: 3 parts are too few" in capsys.readouterr().out
