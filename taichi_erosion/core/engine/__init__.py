"""The engine that compiles kernels: which one, shortcuts through its front end, functions that it lacks."""
