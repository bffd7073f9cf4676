"""What a careful reader can prove wrong in a published table of runs, and in what is said about it."""
