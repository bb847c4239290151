"""`trackslip grid`: runs over any axes, on one process or many, to be gone on with whenever they are stopped."""
