"""From snapshots and photographs to publishable numbers: value, standard deviation, unit, number of repeats.

Every measure returns a `Measurement`. Where a state holds no answer (no grains, one layer, no flank) the
value is NaN and the notes say why. Only NumPy and SciPy are spoken here.
"""
