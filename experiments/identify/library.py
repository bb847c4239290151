"""The report on `trackslip.identify(...)`, which `trackslip` loads through an entry point."""

from experiments.common.manifest import origin, versions
from experiments.common.plain_json import plain
from experiments.identify.page import page
from trackslip.identification.result import Identification


def identification_page(result: Identification) -> str:
    """The HTML page that `trackslip identify` writes, for an identification made in Python."""
    about = {"versions": versions(), "geometry": result.geometry, **origin(result.logs)}
    return page(result, "Slip laws", "trackslip.identify(...).report(...)", plain(about)).html()
