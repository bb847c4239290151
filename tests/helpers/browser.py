"""Pages rendered by headless Chromium."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
_OPTIONS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync", "--disable-quic", "--hide-scrollbars", "--window-size=1500,1000"),
    *("--enable-logging=stderr", "--v=0", "--dump-dom"),
)
# a window can't be as narrow as a phone, a frame can; one made of srcdoc may be looked into
_HOST = """<!DOCTYPE html><html><body><pre id="found"></pre>{frames}<script>
function scrolls(element) {{ return /auto|scroll/.test(getComputedStyle(element).overflowX); }}
function inScroller(element) {{
  for (let above = element.parentElement; above; above = above.parentElement) if (scrolls(above)) return true;
  return false;
}}
function look(frame) {{
  const page = frame.contentDocument, width = frame.contentWindow.innerWidth;
  const beyond = [...page.body.querySelectorAll(":not(svg *)")]
    .filter(element => element.getBoundingClientRect().right > width + 0.5 && !inScroller(element));
  return {{
    width: width,
    scroll_width: page.documentElement.scrollWidth,
    beyond: beyond.map(element => element.outerHTML.slice(0, 80)),
    loaded: frame.contentWindow.performance.getEntriesByType("resource").map(entry => entry.name),
    figures: page.querySelectorAll("figure svg").length,
  }};
}}
window.onload = () => {{
  const frames = [...document.querySelectorAll("iframe")];
  document.getElementById("found").textContent = JSON.stringify(frames.map(look));
}};
</script></body></html>"""


@dataclass(frozen=True)
class Look:
    """A page as rendered by a browser."""

    frames: list[dict[str, Any]]
    """Measurements at each width."""
    console: list[str]
    """Lines on the browser's console."""


def look_at(page: str, widths: tuple[int, ...] = (400, 1400)) -> Look:
    """Render the page in frames of the given widths [px]; skips the test without Chromium."""
    browser = next(filter(None, map(shutil.which, _NAMES)), None)
    if browser is None:
        pytest.skip(f"none of {', '.join(_NAMES)} is installed")
    frame = '<iframe style="width: {}px; height: 900px; border: 0" srcdoc="{}"></iframe>'
    host = _HOST.format(frames="".join(frame.format(width, html.escape(page)) for width in widths))
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        file = Path(folder) / "host.html"
        file.write_text(host, encoding="utf-8")
        command = [browser, *_OPTIONS, f"--user-data-dir={folder}/profile", file.as_uri()]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    found = re.search(r'<pre id="found">(.+?)</pre>', done.stdout, re.DOTALL)
    assert found, "the page has not been loaded"
    return Look(json.loads(html.unescape(found[1])), [line for line in done.stderr.splitlines() if "CONSOLE" in line])


def assert_fits(page: str) -> Look:
    """Assert an empty console, no loaded resources, and no overflow on a phone or a desktop."""
    seen = look_at(page)
    assert seen.console == []
    assert [frame["width"] for frame in seen.frames] == [400, 1400]
    for frame in seen.frames:
        assert frame["scroll_width"] == frame["width"]
        assert frame["beyond"] == []
        assert frame["loaded"] == []
    return seen
