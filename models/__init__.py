"""MJCF models: data, no code. See README.md in this folder."""
