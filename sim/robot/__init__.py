"""The robot: its model, its parameters and its file."""
