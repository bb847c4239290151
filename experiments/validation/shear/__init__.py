"""Ground that shears, compared with theory."""
