"""The shortest experiment: drives designed to tell a slip law as well as possible."""
