"""The flow grid: wind above and inside the bed."""
