"""Records and services of every room: units, device, setup, effect interface, snapshots, files, errors."""
