"""Search of sets of effects: steps over refits, and strengths beyond the largest of the list."""
