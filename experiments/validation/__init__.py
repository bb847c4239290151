"""What `trackslip validate` measures: one file per question asked of the simulator."""
