"""New studies from tables, and the validation of studies."""
