"""Grain decomposition: one thread per grain, or per pair of grains, and all replicas in one launch.

The step is that of `simulation/step.py`, from the same device functions of contact, effects and motion; only
the order of the work differs. Every stage is a loop over all grains, pairs or cells of the device, and the
host launches many steps without reading anything back. In molecular dynamics this is the atom decomposition.

Reference: Plimpton (1995), J. Comput. Phys. 117, 1 (decompositions); Green (2010), Particle Simulation using
CUDA, NVIDIA (cells by a sort on the device).
"""
