"""One file per command, each with a `run` that reads options, calls, stores and prints."""
