"""Tables and figures, put on a page."""
