"""Published numbers that claims are compared with.

Oblique and spinning impacts (tests 4 and 6): digitised from the figures of Chung & Ooi by Kratos
Multiphysics, DEM benchmarks 4 and 8.

Reference: Chung & Ooi (2011), Granular Matter 13, 643; Kharaz, Gorham & Salman (2001), Powder Technology
120, 281.

Lid-driven cavity: velocities on the middle lines by Reynolds number. The value of v at x = 0.9063 for
Re = 400 is misprinted in the source (it lies far off the curve of its neighbours) and stands here as NaN.

Reference: Ghia, Ghia & Shin (1982), J. Comput. Phys. 48, 387-411, tables I and II.
"""

import numpy as np

from taichi_erosion.core.setup import Floats


def numbers(words: str) -> Floats:
    return np.array(words.split(), dtype=np.float64)


OBLIQUE_ANGLE = numbers("5 10 15 20 25 30 35 40 50 60 70 80 85")  # deg
OBLIQUE_LITERATURE_RESTITUTION = numbers(
    "0.948 0.687 0.624 0.616 0.634 0.684 0.737 0.781 0.845 0.893 0.932 0.966 0.983"
)
OBLIQUE_LITERATURE_SPIN = numbers("-19.3 -213 -378 -511 -599 -617 -582 -545 -457 -357 -246 -126 -63")  # rad/s
OBLIQUE_LITERATURE_PATCH = numbers("3.8 -1.6 -5.5 -7.5 -7.5 -3.5 3.4 11.6 29.4 47.8 64.6 78.7 84.5")  # deg
SPINNING_X = numbers("0.187 0.358 0.551 0.765 0.979 1.214 1.492 1.77 2.52 3.63 5.77 7.84 11.9 24")

# y, u at Re = 100, 400, 1000, x, v at the same
GHIA = numbers("""
     1        1        1        1      1        0        0        0
0.9766  0.84123  0.75837  0.65928 0.9688 -0.05906 -0.12146 -0.21388
0.9688  0.78871  0.68439  0.57492 0.9609 -0.07391 -0.15663 -0.27669
0.9609  0.73722  0.61756  0.51117 0.9531 -0.08864 -0.19254 -0.33714
0.9531  0.68717  0.55892  0.46604 0.9453 -0.10313 -0.22847 -0.39188
0.8516  0.23151  0.29093  0.33304 0.9063 -0.16914      nan -0.51550
0.7344  0.00332  0.16256  0.18719 0.8594 -0.22445 -0.44993 -0.42665
0.6172 -0.13641  0.02135  0.05702 0.8047 -0.24533 -0.38598 -0.31966
   0.5 -0.20581 -0.11477 -0.06080    0.5  0.05454  0.05186  0.02526
0.4531 -0.21090 -0.17119 -0.10648 0.2344  0.17527  0.30174  0.32235
0.2813 -0.15662 -0.32726 -0.27805 0.2266  0.17507  0.30203  0.33075
0.1719 -0.10150 -0.24299 -0.38289 0.1563  0.16077  0.28124  0.37095
0.1016 -0.06434 -0.14612 -0.29730 0.0938  0.12317  0.22965  0.32627
0.0703 -0.04775 -0.10338 -0.22220 0.0781  0.10890  0.20920  0.30353
0.0625 -0.04192 -0.09266 -0.20196 0.0703  0.10091  0.19713  0.29012
0.0547 -0.03717 -0.08186 -0.18109 0.0625  0.09233  0.18360  0.27485
     0        0        0        0      0        0        0        0
""").reshape(17, 8)
Y, X = GHIA[:, 0], GHIA[:, 4]
U: dict[int, Floats] = dict(zip((100, 400, 1000), GHIA[:, 1:4].T, strict=True))
V: dict[int, Floats] = dict(zip((100, 400, 1000), GHIA[:, 5:8].T, strict=True))
