"""Tensors in, tensors out: quaternions, rotations, Euler angles. Knows nothing of joints."""
