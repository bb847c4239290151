"""Planning of drives that determine a slip law as precisely as possible within an area and a
time.
"""
