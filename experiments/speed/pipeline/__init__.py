"""What the stages of the pipeline cost beside the bare engine, one module per area."""
