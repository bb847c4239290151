"""`trackslip view`: show stored runs in the rerun viewer, in the browser, or in a file."""

from experiments.options.view import ViewConfig as Config

EXAMPLES = (
    ("the first run", "trackslip view out/track"),
    ("compare two runs", 'trackslip view out/reproduce --run "linear none" --run "linear icr"'),
    ("a file for the viewer", "trackslip view log.csv --save log.rrd"),
)


def run(config: Config) -> None:
    """Read, choose, show."""
    from experiments.work.view import run as work

    work(config)
