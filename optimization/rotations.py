"""Rotation vectors: many at once, in plain arrays."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from robomirror_drake.messages import Array
from robomirror_drake.optimization.centroidal import cross_matrix


def exp(phi: Array) -> Array:
    """(…, 3, 3) rotations by vectors (…, 3) [rad]."""
    flat = Rotation.from_rotvec(phi.reshape(-1, 3)).as_matrix()
    return np.asarray(flat).reshape(*phi.shape, 3)


def exp_quaternion(phi: Array) -> Array:
    """(N, 4) quaternions wxyz of rotations by vectors (N, 3) [rad], continuous in them."""
    return np.asarray(Rotation.from_rotvec(phi).as_quat(scalar_first=True))


def log(R: Array) -> Array:
    """(…, 3) rotation vectors of rotations (…, 3, 3) [rad]."""
    flat = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec()
    return np.asarray(flat).reshape(R.shape[:-1])


def quaternion(R: Array) -> Array:
    """(N, 4) quaternions wxyz of rotations (N, 3, 3)."""
    return np.asarray(Rotation.from_matrix(R).as_quat(scalar_first=True))


def left_jacobian(phi: Array) -> Array:
    """(…, 3, 3) J with ω = J φ̇ in the axes that exp(φ) maps to."""
    square = np.sum(phi * phi, axis=-1)[..., None, None]
    angle = np.sqrt(square)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    b = np.where(small, 0.5 - square / 24, (1.0 - np.cos(safe)) / safe**2)
    c = np.where(small, 1 / 6 - square / 120, (safe - np.sin(safe)) / safe**3)
    K = cross_matrix(phi)
    return np.asarray(np.eye(3) + b * K + c * (K @ K))
