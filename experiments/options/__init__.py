"""What each command accepts, as frozen dataclasses. Importing them loads no simulator."""
