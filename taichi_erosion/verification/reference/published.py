"""Published figures, as the verification notes of this project list them.

T4 own values: fine-step integration of the total form (see `mindlin.Sliding.TABLE`). Chung & Ooi values:
digitised from their figures by Kratos Multiphysics, DEM benchmarks 4 and 8.

Reference: Chung & Ooi (2011), Granular Matter 13, 643; Kharaz, Gorham & Salman (2001), Powder Technology
120, 281.
"""

import numpy as np

TEST4_ANGLE = np.array([5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 50.0, 60.0, 70.0, 80.0, 85.0])  # deg

TEST4_OXIDE_RESTITUTION = np.array(
    [0.9507, 0.7022, 0.6334, 0.6226, 0.6397, 0.6845, 0.7398, 0.7829, 0.8471, 0.8948, 0.9337, 0.9679, 0.9841]
)
TEST4_OXIDE_SPIN = np.array(  # rad s-1
    [-16.75, -201.7, -370.1, -503.3, -593.8, -615.2, -582.0, -544.3, -456.7, -355.2, -243.0, -123.4, -61.9]
)
TEST4_OXIDE_PATCH = np.array(  # deg
    [4.225, -0.436, -4.428, -6.793, -7.080, -3.516, 3.655, 11.618, 29.486, 48.158, 65.086, 78.983, 84.812]
)
TEST4_ALLOY_RESTITUTION = np.array([0.9062, 0.6784, 0.6193, 0.6145, 0.6360])  # 5 to 25 deg, then as the oxide

TEST4_LITERATURE_RESTITUTION = np.array(
    [0.948, 0.687, 0.624, 0.616, 0.634, 0.684, 0.737, 0.781, 0.845, 0.893, 0.932, 0.966, 0.983]
)
TEST4_LITERATURE_SPIN = np.array(  # rad s-1
    [-19.3, -213.0, -378.0, -511.0, -599.0, -617.0, -582.0, -545.0, -457.0, -357.0, -246.0, -126.0, -63.0]
)
TEST4_LITERATURE_PATCH = np.array(
    [3.8, -1.6, -5.5, -7.5, -7.5, -3.5, 3.4, 11.6, 29.4, 47.8, 64.6, 78.7, 84.5]
)  # deg

TEST6_X = np.array(
    [0.187, 0.358, 0.551, 0.765, 0.979, 1.214, 1.492, 1.77, 2.52, 3.63, 5.77, 7.84, 11.9, 24.0]
)
TEST6_BETA = np.array(
    [
        -0.815,
        -0.626,
        -0.439,
        -0.238,
        -0.017,
        0.096,
        0.111,
        0.090,
        0.006,
        -0.103,
        -0.162,
        -0.204,
        -0.259,
        -0.339,
    ]
)
