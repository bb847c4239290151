"""`trackslip validate`: the simulated robot against theory."""
