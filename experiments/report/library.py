"""The report of `trackslip.identify(...)`, which the library finds by an entry point."""

from experiments.report.identification import page
from experiments.storage.manifest import versions
from experiments.storage.plain_json import plain
from trackslip.identification.result import Identification
from trackslip.identification.source import origin


def identification_page(found: Identification) -> str:
    """The HTML page that `trackslip identify` writes, for an identification made in Python."""
    about = {"versions": versions(), "geometry": found.geometry, **origin(found.logs)}
    return page(found, "Slip laws", "trackslip.identify(...).report(...)", plain(about)).html()
