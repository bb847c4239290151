"""`trackslip benchmark`: compare controllers and slip compensations on paths, grounds and drawn
robots.
"""
