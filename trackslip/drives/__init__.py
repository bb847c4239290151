"""Raw records made into clean drives, and a first look at them before any law is fitted."""
