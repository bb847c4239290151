"""The documentation's site: built strictly, complete, and readable from file:// without network."""

import shutil
import subprocess
import sys
from html.parser import HTMLParser
from urllib.parse import unquote

import api_pages
import pytest
from pages import ROOT


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    pytest.importorskip("zensical", reason="the extra `docs` isn't installed")
    folder = tmp_path_factory.mktemp("site")
    shutil.copytree(ROOT / "docs", folder / "docs")
    for package in ("trackslip", "sim"):
        (folder / package).symlink_to(ROOT / package)
    config = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    (folder / "mkdocs.yml").write_text(
        config.replace("site_dir: out/docs", "site_dir: site"), encoding="utf-8"
    )
    done = subprocess.run(
        [sys.executable, "-m", "zensical", "build", "--strict"],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    (folder / "site" / "404.html").unlink()  # only servers show it, and what it loads is theirs
    return folder / "site"


class References(HTMLParser):
    """The resources and anchors of a page."""

    def __init__(self, page):
        super().__init__()
        self.loaded = []
        self.anchors = set()
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.anchors.add(given.get("id"))
        if "src" in given or (
            tag == "link" and given.get("rel") not in ("canonical", "next", "prev")
        ):
            self.loaded.append(given.get("src") or given["href"])


def test_every_page_has_its_names_and_needs_no_network(
    site,
):
    for page in (ROOT / "docs").rglob("*.md"):
        name = (
            "index.html"
            if page.name == "README.md"
            else page.with_suffix(".html").relative_to(ROOT / "docs")
        )
        assert (site / name).is_file()
    for package in api_pages.PACKAGES:
        names = {name for names in api_pages.rooms(package).values() for name in names}
        assert names <= References(site / "api" / f"{package}.html").anchors
    for page in site.rglob("*.html"):
        assert "$$" not in page.read_text(encoding="utf-8")
        for link in References(page).loaded:
            assert (
                link.startswith("data:")
                or (page.parent / unquote(link).partition("?")[0]).is_file()
            ), link


@pytest.mark.parametrize("package", api_pages.PACKAGES)
def test_the_api_pages_list_the_public_names(package):
    """If this fails, run `python tests/helpers/api_pages.py`."""
    assert (ROOT / "docs" / "api" / f"{package}.md").read_text(encoding="utf-8") == api_pages.page(
        package
    )
