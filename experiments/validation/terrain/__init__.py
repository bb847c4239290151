"""What `trackslip validate --terrain` measures: tracks made with `sim.tracks` compared with theory, a file a question."""
