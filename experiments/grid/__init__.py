"""`trackslip grid`: runs over any axes, on one process or many, which can be resumed after any interruption."""
