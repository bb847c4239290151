"""Estimation of the body twist from poses over time."""
