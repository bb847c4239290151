"""Estimates of the body twist from poses over time."""
