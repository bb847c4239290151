"""What a user runs: the `trackslip` commands."""
