"""Starting commands in less time: libraries that import, check or document more than a command needs."""
