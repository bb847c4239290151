"""What `trackslip validate` measures: a file for each question that is put to the simulator."""
