"""The flow grid: wind above and inside the bed.

`momentum` holds the balance term by term, `implicit_z` its solve along z, `pressure/` the projection,
`turbulence` and `wall_law` the closure, `boundary` the sides. Each formula is a device function of one
cell, column or line and stands once, and so does each loop over them, from a first replica to a last: at the
top of a kernel Taichi runs it in parallel over all replicas, inside the loop of a thread in order over one.
`step` has both schedules.

`column` is the grid with one column of cells: it shares conductances, sources, wall law, mixing length
over the floor and elimination. It keeps one solve for both velocities, where the grid would solve twice
with the same coefficients, and the strain du/dz alone, where the grid takes all components and needs ghost
cells beside it; merged, the strain of every column would move by rounding.
"""
