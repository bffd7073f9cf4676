"""What leaves the process as bytes: recordings, pictures, checkpoints.

Only this room imports rerun, and only inside the functions that need it: the import takes half a second.
"""
