"""What `trackslip bench` measures."""
