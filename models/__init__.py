"""MJCF models, robot files and courses; see README.md in this folder."""
