"""Path-tracking controllers that follow the protocol in `base`."""
