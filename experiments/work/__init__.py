"""What commands do, until it has moved to its room."""
