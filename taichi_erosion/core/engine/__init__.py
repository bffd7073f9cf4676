"""The engine that compiles kernels: which one, and shortcuts through its front end. `core/ti.py` uses it."""
