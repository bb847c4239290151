"""One tracked robot over a course: who drives it, what is recorded, and what the record says."""
