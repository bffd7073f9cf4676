"""PNG pictures that commands write: the detection in a photograph, the curve of a live session."""
