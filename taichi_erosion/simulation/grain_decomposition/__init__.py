"""Grain decomposition: one thread per grain, and all replicas in one launch of many steps.

The step is that of `simulation/step.py`, from the same device functions of contact, effects and motion; only
the order of the work differs. A stage is a loop over all grains, cells or replicas of the device. All threads
of the launch stay resident and wait for each other between stages, so that the time loop, the looks at the
lists and the exchanges run on the device, and the host starts thousands of steps at once.

In molecular dynamics this is the atom decomposition with a full list: both grains of a pair evaluate its
contact law, from the same numbers in the same order, and no thread adds to the force of another grain.

Reference: Plimpton (1995), J. Comput. Phys. 117, 1 (decompositions); Green (2010), Particle Simulation using
CUDA, NVIDIA (cells by a sort on the device); Xiao & Feng (2010), IPDPS, 1 (a barrier of all blocks).
"""
