"""Path-tracking controllers, a file each behind the protocol of `base`."""
