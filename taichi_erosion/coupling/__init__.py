"""Two-way coupling of grains and air: drag, momentum exchange, spin-up."""
