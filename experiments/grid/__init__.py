"""`trackslip grid`: drive every combination of radius, speed and any other option."""
