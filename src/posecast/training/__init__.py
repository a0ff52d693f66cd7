"""One training run: losses, feeding, sampling, the Lightning module."""
