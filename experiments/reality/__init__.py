"""Predictions of real robots, compared with their logs."""
