"""Many runs: planned, executed, put in a table."""
