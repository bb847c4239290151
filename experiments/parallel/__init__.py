"""Worker processes, clusters and interrupts."""
