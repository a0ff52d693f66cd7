"""Tensors in, tensors out: quaternions, rotations, Euler angles. Knows nothing of joints."""

from posecast.geometry import conversions, dual_quaternion, euler, quaternion
from posecast.geometry.conversions import (
    axis_angle_to_quaternion,
    matrix_to_ortho6d,
    matrix_to_quaternion,
    nearest_rotation,
    ortho6d_to_matrix,
    ortho6d_to_quaternion,
    quaternion_to_axis_angle,
    quaternion_to_matrix,
    quaternion_to_ortho6d,
)
from posecast.geometry.euler import (
    ORDERS,
    euler_to_quaternion,
    h36m_euler,
    quaternion_to_euler,
)

__all__ = [
    "ORDERS",
    "axis_angle_to_quaternion",
    "conversions",
    "dual_quaternion",
    "euler",
    "euler_to_quaternion",
    "h36m_euler",
    "matrix_to_ortho6d",
    "matrix_to_quaternion",
    "nearest_rotation",
    "ortho6d_to_matrix",
    "ortho6d_to_quaternion",
    "quaternion",
    "quaternion_to_axis_angle",
    "quaternion_to_euler",
    "quaternion_to_matrix",
    "quaternion_to_ortho6d",
]
