"""Planning of drives that determine a slip law precisely within an area and a time."""
