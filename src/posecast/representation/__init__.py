"""How a pose is written as numbers, and those numbers for a network."""
