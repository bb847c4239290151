"""The robot: model, parameters and robot files."""
