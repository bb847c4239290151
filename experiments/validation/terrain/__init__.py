"""What `trackslip validate --terrain` measures: tracks on terrain compared with theory, a file a question."""
