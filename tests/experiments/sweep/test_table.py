"""The table of a grid's runs, as documented."""

from pathlib import Path

import pyarrow.parquet

from experiments.sweep.axes import AXES
from experiments.sweep.table import COLUMNS, write_table
from trackslip.logs.schema import markdown

TABLE = markdown([*COLUMNS.values(), *AXES.values()])
DOCS = Path(__file__).parents[3] / "docs" / "data.md"


def test_the_documented_table_is_the_codes():
    assert DOCS.read_text(encoding="utf-8").count(f"\n{TABLE}\n") == 1


def test_every_column_that_is_written_is_documented(tmp_path):
    row = {"run": "r", "id": "0", "radius": 0.5, "speed": 0.1, "ground": "ice", "v": 0.1}
    write_table([row], ["ground", "radius", "speed"], tmp_path / "table.parquet")
    schema = pyarrow.parquet.read_schema(tmp_path / "table.parquet")
    assert schema.names == ["run", "id", "ground", "radius", "speed", *list(COLUMNS)[2:]]
    for field in schema:
        unit, what = (field.metadata[key].decode() for key in (b"unit", b"description"))
        assert f"| `{field.name}` | {unit or '–'} | {what} |" in TABLE
