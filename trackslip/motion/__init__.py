"""Poses over time -> smooth poses and the body twist."""
