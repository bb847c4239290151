"""Processes, clusters and interrupts."""
