"""Contact mechanics of grains: state, neighbour lists, contact laws, walls, integration."""
