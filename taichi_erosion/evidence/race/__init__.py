"""One race: everything that could explain a misfit competes at once, and one rule decides."""
