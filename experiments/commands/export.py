"""`trackslip export`: stored runs as CSV, for spreadsheets and for programs without Parquet."""

from experiments.options.export import ExportConfig as Config

EXAMPLES = (
    ("list the runs", "trackslip export out/grid"),
    ("write all runs as CSV", "trackslip export out/grid --csv"),
    ("write one run", 'trackslip export out/grid --csv --run "radius=0.5 speed=0.1" --out run.csv'),
)


def run(config: Config) -> None:
    """List the runs, or write them."""
    from experiments.work.export import run as work

    work(config)
