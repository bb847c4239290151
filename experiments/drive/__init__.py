"""`trackslip drive`: a tracked robot drives over a course."""
