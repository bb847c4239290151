"""The example notebooks: stored with outputs that are those of a run, and shown in the docs."""

import base64
import re

import notebooks
import pytest

FILES = notebooks.NOTEBOOKS
_NUMBER = re.compile(r"[-−]?\d[\d,]*\.?\d*(?:e[-+]\d+)?")
_PLACES = re.compile(r"/(?:home|root|tmp|work|Users|mnt|opt|usr)/")
_LARGEST = 400e3  # of a notebook with its figures [bytes]


def name(file):
    return file.stem


def outputs(notebook):
    """The outputs of each code cell."""
    return [cell["outputs"] for cell in notebook["cells"] if cell["cell_type"] == "code"]


def texts(cell):
    """The kinds and texts of a cell's outputs; figures by kind alone."""
    found = []
    for output in cell["outputs"]:
        assert output["output_type"] != "error", output
        if output["output_type"] == "stream":
            found.append(("stream", "".join(output["text"])))
        for kind, value in output.get("data", {}).items():
            found.append((kind, "" if kind == "image/png" else "".join(value)))
    return found


def numbers(text):
    return [float(x.replace(",", "").replace("−", "-")) for x in _NUMBER.findall(text)]


def test_there_are_three_notebooks():
    stems = {file.stem for file in FILES}
    assert stems == {"identify_your_robot", "benchmark_your_controller", "train_and_look"}


@pytest.mark.parametrize("file", FILES, ids=name)
def test_outputs_are_stored_small_and_name_no_machine(file):
    assert file.stat().st_size < _LARGEST
    notebook = notebooks.read(file)
    assert notebook == notebooks.stable(notebook), "volatile metadata is stored"
    shown = [texts(cell) for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert sum(kind == "image/png" for cell in shown for kind, _ in cell) >= 2
    for kind, text in (output for cell in shown for output in cell):
        assert not _PLACES.search(text), (kind, text)
        assert "\x1b" not in text


@pytest.mark.parametrize("file", FILES, ids=name)
def test_the_page_in_the_docs_shows_the_notebook(file):
    """If this fails, run `python tests/helpers/notebooks.py`."""
    text, images = notebooks.page(file)
    assert (notebooks.PAGES / f"{file.stem}.md").read_text(encoding="utf-8") == text
    assert {path.name for path in notebooks.PAGES.glob(f"{file.stem}_*.png")} == set(images)
    for place, image in images.items():
        assert (notebooks.PAGES / place).read_bytes() == image


@pytest.mark.slow
@pytest.mark.parametrize("file", FILES, ids=name)
def test_a_run_gives_the_stored_outputs(file, tmp_path):
    pytest.importorskip("nbclient", reason="nbclient isn't installed")
    pytest.importorskip("ipykernel", reason="ipykernel isn't installed")
    if file.stem == "train_and_look":
        pytest.importorskip("stable_baselines3", reason="Stable-Baselines3 is not installed")
    stored = notebooks.read(file)["cells"]
    again = notebooks.executed(file, tmp_path)["cells"]
    for before, now in zip(stored, again, strict=True):
        assert before["source"] == now["source"]
        if before["cell_type"] == "markdown":
            continue
        expected = texts(before)
        found = texts(now)
        assert [kind for kind, _ in found] == [kind for kind, _ in expected]
        if notebooks.VARIES in before["metadata"].get("tags", []):
            continue
        for (_, new), (_, old) in zip(found, expected, strict=True):
            assert _NUMBER.sub("#", new) == _NUMBER.sub("#", old)
            assert numbers(new) == pytest.approx(numbers(old), rel=0.01, abs=1e-4)


def test_a_figure_is_stored_once_as_png():
    image = base64.b64encode(b"\x89PNG").decode()
    figure = {
        "output_type": "display_data",
        "data": {"image/png": image + "\n", "text/plain": "<Figure size 900x300>"},
        "metadata": {"image/png": {"width": 900}},
    }
    progress = {"output_type": "stream", "name": "stderr", "text": "50 %"}
    cell = {
        "cell_type": "code",
        "metadata": {"execution": {"started": "now"}, "tags": ["varies"]},
        "source": "draw()",
        "outputs": [progress, figure],
    }
    kept = notebooks.stable({"cells": [cell]})["cells"][0]
    assert kept["metadata"] == {"tags": ["varies"]}
    (output,) = kept["outputs"]
    assert output["data"] == {"image/png": image}
    assert output["metadata"] == {}
