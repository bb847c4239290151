"""How results look: as text with symbols and units, as HTML in notebooks, as Arrow tables and as
figures.

`trackslip.viewable.Viewable` gives results their methods, which import the modules here when they
are called: `summaries` for HTML, `frames` for tables, and `figures`, which needs matplotlib.
`symbols` and `numbers` write symbols, units and intervals, in reports, too.
"""
