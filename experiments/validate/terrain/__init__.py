"""Tracks on terrain compared with theory, for `trackslip validate --terrain`."""
