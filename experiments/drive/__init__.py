"""`trackslip drive`: drive a tracked robot over a course."""
