"""Options shared by commands, as frozen dataclasses. Importing them loads no simulator."""
