"""Slip laws from any driving: the maximum likelihood of whole logs."""
