"""Do we solve the equations right? Claims with a value found, the value expected and an argued tolerance."""
