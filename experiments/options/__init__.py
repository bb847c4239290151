"""What each command accepts. Importing this starts no simulator."""
