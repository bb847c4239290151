"""Monte-Carlo studies of estimators and plans: repeated trials whose truth is known, and their statistics."""
