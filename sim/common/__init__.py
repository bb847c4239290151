"""What all rooms share: settings, files of arrays, and seeds."""
