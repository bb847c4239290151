"""Suites of checks against theory, for `trackslip validate`."""
