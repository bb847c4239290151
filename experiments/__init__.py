"""The `trackslip` command line and the experiments that it runs."""
