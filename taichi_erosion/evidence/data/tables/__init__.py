"""Reading of tables: files of spreadsheets, what their columns are, the tidy form."""
