"""The report of `trackslip.identify(...)`, which the library finds by an entry point."""

from experiments.report.reproduction import Report, render
from experiments.storage.manifest import versions
from experiments.storage.plain_json import plain
from trackslip.identification.result import Identification
from trackslip.identification.source import origin


def identification_page(found: Identification) -> str:
    """The HTML page that `trackslip identify` writes, for an identification made in Python."""
    about = {"versions": versions(), "geometry": found.geometry, **origin(found.logs)}
    report = Report(
        title="Slip laws",
        command="trackslip.identify(...).report(...)",
        manifest=plain(about),
        grid_logs=found.logs,
        identification=found,
    )
    return render(report).html
