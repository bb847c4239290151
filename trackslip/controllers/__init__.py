"""Path-tracking controllers, one per file, that follow the protocol in `base`."""
