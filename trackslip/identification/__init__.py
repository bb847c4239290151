"""Runs -> steady slip samples -> slip laws fitted to them, with intervals, compared."""
