"""PNG pictures that commands write, and how measured values are marked in figures."""
