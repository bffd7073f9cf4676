"""What the simulator is held against: closed forms, integrators written a second time in NumPy, published
figures.
"""
