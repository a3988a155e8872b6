"""A calibration while it is recorded: rests as they end, what they tell so far, where to turn next, when to stop.

NumPy only: nothing is compiled, so that the first answer comes at once.
"""
