"""Execute the example notebooks anew, keep what doesn't change from run to run, and write the pages
that the documentation shows of them.

Run `python tests/helpers/notebooks.py` after a notebook has changed (name some to execute only
these); it takes minutes. The fast tests say when pages are stale, the slow tests when outputs are.
"""

import base64
import json
import os
import re
import shutil
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "examples" / "notebooks"
PAGES = ROOT / "docs" / "notebooks"
NOTEBOOKS = tuple(sorted(FOLDER.glob("*.ipynb")))
VARIES = "varies"
"""Tag of cells whose numbers differ between machines, as those of training."""
_TIMEOUT = 900  # for a cell, on a busy machine [s]
_KEPT = ("image/png", "text/html", "text/plain")
"""Kinds of output that are kept, the one to show first."""


def executed(file, folder):
    """The notebook with outputs of a run in a copy of the examples in `folder`."""
    import nbformat
    from nbclient import NotebookClient

    place = folder / "notebooks"
    place.mkdir(parents=True)
    (folder / "logs").symlink_to(ROOT / "examples" / "logs")
    notebook = nbformat.read(file, as_version=4)
    # commands of cells are those of this Python
    before = dict(os.environ)
    os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    os.environ["PYTHONPATH"] = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    os.environ["COLUMNS"] = "120"
    try:
        client = NotebookClient(
            notebook,
            timeout=_TIMEOUT,
            kernel_name="python3",
            resources={"metadata": {"path": str(place)}},
        )
        client.execute()
    finally:
        os.environ.clear()
        os.environ.update(before)
    return stable(json.loads(nbformat.writes(notebook)))


def stable(notebook):
    """A notebook without times, versions and empty outputs; texts of a stream are joined."""
    cells = []
    for number, cell in enumerate(notebook["cells"], start=1):
        kept = {
            "cell_type": cell["cell_type"],
            "id": f"cell-{number}",
            "metadata": {"tags": tags} if (tags := cell["metadata"].get("tags")) else {},
            "source": _lines(cell["source"]),
        }
        if cell["cell_type"] == "code":
            outputs = [_stable_output(output) for output in cell["outputs"]]
            kept["execution_count"] = None
            kept["outputs"] = [output for output in outputs if output]
        cells.append(kept)
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    metadata = {"kernelspec": kernel, "language_info": {"name": "python"}}
    return {"cells": cells, "metadata": metadata, "nbformat": 4, "nbformat_minor": 5}


def _stable_output(output):
    """An output without what changes from run to run; None for progress and warnings."""
    if output["output_type"] == "stream":
        if output["name"] != "stdout":
            return None
        return {"name": "stdout", "output_type": "stream", "text": _lines(output["text"])}
    if output["output_type"] == "error":
        return output
    data = {kind: output["data"][kind] for kind in _KEPT if kind in output["data"]}
    if "image/png" in data:
        data = {"image/png": "".join(data["image/png"]).strip()}
    return {
        "data": {
            kind: value if kind == "image/png" else _lines(value) for kind, value in data.items()
        },
        "execution_count": None,
        "metadata": {},
        "output_type": "execute_result",
    }


def _lines(text):
    return "".join(text).splitlines(keepends=True)


def read(file):
    return json.loads(file.read_text(encoding="utf-8"))


def write(file, notebook):
    text = json.dumps(notebook, indent=1, ensure_ascii=False) + "\n"
    file.write_text(text, encoding="utf-8")


def page(file):
    """Markdown of a stored notebook, and its images by file name."""
    images = {}
    parts = []
    for cell in read(file)["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source.replace("](../../docs/", "](../"))
            continue
        parts.append(f"```python\n{source}\n```")
        for output in cell["outputs"]:
            parts.append(_shown(output, file.stem, images))
    where = f"examples/notebooks/{file.name}"
    title, rest = parts[0].split("\n", maxsplit=1)
    note = f"This page shows the notebook `{where}` with the outputs of a run."
    return "\n\n".join([title, note, rest.strip(), *parts[1:]]) + "\n", images


def _shown(output, stem, images):
    """Markdown of an output."""
    if output["output_type"] == "stream":
        return f"```text\n{''.join(output['text']).rstrip()}\n```"
    data = output["data"]
    if "image/png" in data:
        name = f"{stem}_{len(images) + 1}.png"
        images[name] = base64.b64decode(data["image/png"])
        return f"![figure {len(images)}]({name})"
    if "text/html" in data:
        html = re.sub(r"<style.*?</style>\n?", "", "".join(data["text/html"]), flags=re.DOTALL)
        # an empty line would end the HTML
        lines = [line.strip() for line in html.splitlines() if line.strip()]
        return f'<div class="output">\n{chr(10).join(lines)}\n</div>'
    return f"```text\n{''.join(data['text/plain']).rstrip()}\n```"


def write_page(file):
    """Write the page of a notebook, and its images."""
    PAGES.mkdir(exist_ok=True)
    for old in PAGES.glob(f"{file.stem}_*.png"):
        old.unlink()
    text, images = page(file)
    (PAGES / f"{file.stem}.md").write_text(text, encoding="utf-8")
    for name, image in images.items():
        (PAGES / name).write_bytes(image)


def main(names):
    for file in NOTEBOOKS:
        if names and file.stem not in names:
            continue
        folder = Path(tempfile.mkdtemp())
        try:
            write(file, executed(file, folder))
        finally:
            shutil.rmtree(folder)
        write_page(file)
        print(f"{file.name}: {file.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main(sys.argv[1:])
