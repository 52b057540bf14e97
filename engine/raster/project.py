"""Projection of Gaussians to the picture and its gradient, one Gaussian at a time, in float64.

A projected Gaussian is kept in the form that the blending kernels walk row by row. With Σ' = [[a, b], [b, c]] its exponent is

    ½ dᵀ Σ'⁻¹ d = ½ (dx − k dy)² / s + ½ dy² / c,        k = b / c,   s = (a c − b²) / c,

a sum of two squares: no cancellation for long thin Gaussians, and each row's span of pixels can be read off it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from degense.engine.raster.limits import EPS2D, FAR, FOV_MARGIN, MAX_EXTENT, MAX_SCALE, MAX_SQUARE, MIN_ALPHA, MIN_QUAT, NEAR
from degense.engine.threads import take_ticket

LOG2E = math.log2(math.e)
LOG2_MIN_ALPHA = math.log2(MIN_ALPHA)
TILE_WIDTH, TILE_HEIGHT = 32, 16

CHUNK = 512  # Gaussians that a thread takes at once

# Fields of a projected Gaussian, float32 [N, FIELDS]: centre (pixels), k, ½ log2(e) / s and its inverse, ½ log2(e) / c, and
# log2(opacity / MIN_ALPHA).
X, Y, SHEAR, ACROSS, WIDTH, ALONG, HEADROOM = range(7)
FIELDS = 8  # one is unused, so that a Gaussian lies in one half of a cache line
# Tiles that it may touch, int32 [N, 4]: columns [LEFT, RIGHT) and rows [TOP, BOTTOM); empty where it is not drawn.
LEFT, RIGHT, TOP, BOTTOM = range(4)


@njit(nogil=True, error_model="numpy")
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(nogil=True, error_model="numpy")
def _mix(a, u, b, v):
    """a u + b v of numbers and 3-vectors."""
    return a * u[0] + b * v[0], a * u[1] + b * v[1], a * u[2] + b * v[2]


@njit(nogil=True, error_model="numpy")
def _mix3(a, u, b, v, c, w):
    """a u + b v + c w of numbers and 3-vectors."""
    return a * u[0] + b * v[0] + c * w[0], a * u[1] + b * v[1] + c * w[1], a * u[2] + b * v[2] + c * w[2]


@njit(nogil=True, error_model="numpy")
def _is_finite(row, values):
    """Whether a row's squared length is finite in float32; NaN is not."""
    square = 0.0
    for i in range(values.shape[1]):
        square += np.float64(values[row, i]) * np.float64(values[row, i])
    return square <= MAX_SQUARE


@njit(nogil=True, error_model="numpy")
def _unit_quaternion(g, quats):
    """Unit quaternion and 1 / length, which is 0 for one that counts as the identity."""
    w, x, y, z = np.float64(quats[g, 0]), np.float64(quats[g, 1]), np.float64(quats[g, 2]), np.float64(quats[g, 3])
    square = w * w + x * x + y * y + z * z
    if square < MIN_QUAT * MIN_QUAT:
        return 1.0, 0.0, 0.0, 0.0, 0.0
    inverse = 1.0 / math.sqrt(square)
    return w * inverse, x * inverse, y * inverse, z * inverse, inverse


@njit(nogil=True, error_model="numpy")
def _rotate(view, w, x, y, z):
    """Rows of Q = W R: the principal axes in camera space, as columns."""
    r0 = (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y))
    r1 = (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x))
    r2 = (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y))
    q0 = _mix3(view[0, 0], r0, view[0, 1], r1, view[0, 2], r2)
    q1 = _mix3(view[1, 0], r0, view[1, 1], r1, view[1, 2], r2)
    q2 = _mix3(view[2, 0], r0, view[2, 1], r1, view[2, 2], r2)
    return q0, q1, q2


@njit(nogil=True, error_model="numpy")
def _local(g, means, view):
    """Centre in camera space."""
    x, y, z = np.float64(means[g, 0]), np.float64(means[g, 1]), np.float64(means[g, 2])
    return (
        view[0, 0] * x + view[0, 1] * y + view[0, 2] * z + view[0, 3],
        view[1, 0] * x + view[1, 1] * y + view[1, 2] * z + view[1, 3],
        view[2, 0] * x + view[2, 1] * y + view[2, 2] * z + view[2, 3],
    )


@njit(nogil=True, error_model="numpy")
def _slope(ratio, focal, principal, size):
    """x / z held within FOV_MARGIN of the picture, where the Jacobian is taken."""
    margin = FOV_MARGIN * 0.5 * size / focal
    return min((size - principal) / focal + margin, max(-principal / focal - margin, ratio))


@njit(nogil=True, error_model="numpy")
def _scale(g, scales, axis):
    return max(-MAX_SCALE, min(MAX_SCALE, np.float64(scales[g, axis])))


@njit(nogil=True, error_model="numpy")
def _covariance(p0, p1):
    """Σ' = P Pᵀ + EPS2D I and its determinant, without cancellation."""
    a, b, c = _dot(p0, p0), _dot(p0, p1), _dot(p1, p1)
    n0, n1, n2 = p0[1] * p1[2] - p0[2] * p1[1], p0[2] * p1[0] - p0[0] * p1[2], p0[0] * p1[1] - p0[1] * p1[0]
    determinant = n0 * n0 + n1 * n1 + n2 * n2 + EPS2D * (a + c) + EPS2D * EPS2D
    return a + EPS2D, b, c + EPS2D, determinant


@njit(nogil=True, cache=True, error_model="numpy")
def project(means, quats, scales, opacities, features, offsets, view, lens, splats, tiles, depths, radii, counter):
    """Fill `splats` [N, FIELDS], `tiles` [N, 4], `depths` [N] (camera z) and `radii` [N] from float32 Gaussians.

    `view` is the world-to-camera matrix, `lens` is (fx, fy, cx, cy, width, height), both float64; `offsets` [N or 0, 2].
    """
    fx, fy, cx, cy, width, height = lens
    columns, rows = math.ceil(width / TILE_WIDTH), math.ceil(height / TILE_HEIGHT)
    while True:
        begin = take_ticket(counter) * CHUNK
        if begin >= means.shape[0]:
            break
        for g in range(begin, min(begin + CHUNK, means.shape[0])):
            tiles[g, LEFT] = tiles[g, RIGHT] = tiles[g, TOP] = tiles[g, BOTTOM] = 0
            radii[g] = 0
            opacity = min(1.0, np.float64(opacities[g]))
            x, y, z = _local(g, means, view)
            finite = _is_finite(g, means) and _is_finite(g, quats) and _is_finite(g, scales) and _is_finite(g, features)
            if not (finite and opacities[g] <= math.sqrt(MAX_SQUARE) and opacity >= MIN_ALPHA and NEAR <= z <= FAR):
                continue
            inverse_z = 1.0 / z
            x, y, i0, i1 = x * inverse_z, y * inverse_z, fx * inverse_z, fy * inverse_z
            u, v = fx * x + cx, fy * y + cy
            if offsets.shape[0] > 0:
                if not _is_finite(g, offsets):
                    continue
                u += offsets[g, 0]
                v += offsets[g, 1]

            qw, qx, qy, qz, _ = _unit_quaternion(g, quats)
            q0, q1, q2 = _rotate(view, qw, qx, qy, qz)
            sx, sy, sz = _scale(g, scales, 0), _scale(g, scales, 1), _scale(g, scales, 2)
            j0, j1 = -i0 * _slope(x, fx, cx, width), -i1 * _slope(y, fy, cy, height)
            p0 = _mix(i0, q0, j0, q2)
            p1 = _mix(i1, q1, j1, q2)
            p0 = (p0[0] * sx, p0[1] * sy, p0[2] * sz)
            p1 = (p1[0] * sx, p1[1] * sy, p1[2] * sz)
            a, b, c, determinant = _covariance(p0, p1)

            headroom = math.log2(opacity) - LOG2_MIN_ALPHA
            reach, deviation_x, deviation_y = math.sqrt(2.0 / LOG2E * headroom), math.sqrt(a), math.sqrt(c)
            extent = min(MAX_EXTENT, reach)
            box_x, box_y = math.ceil(extent * deviation_x), math.ceil(extent * deviation_y)
            if not (u + box_x > 0.0 and u - box_x < width and v + box_y > 0.0 and v - box_y < height):
                continue
            radii[g] = np.int32(min(max(box_x, box_y), 2147483647))
            depths[g] = z
            half_x, half_y = reach * deviation_x, reach * deviation_y
            tiles[g, LEFT] = int(min(width, max(0.0, u - half_x)) / TILE_WIDTH)
            tiles[g, RIGHT] = min(columns, int(min(width, max(0.0, u + half_x)) / TILE_WIDTH) + 1)
            tiles[g, TOP] = int(min(height, max(0.0, v - half_y)) / TILE_HEIGHT)
            tiles[g, BOTTOM] = min(rows, int(min(height, max(0.0, v + half_y)) / TILE_HEIGHT) + 1)
            inverse_c = 1.0 / c
            splats[g, X], splats[g, Y], splats[g, SHEAR] = u, v, b * inverse_c
            splats[g, ACROSS] = 0.5 * LOG2E * c / determinant
            splats[g, WIDTH] = 2.0 / LOG2E * determinant * inverse_c
            splats[g, ALONG] = 0.5 * LOG2E * inverse_c
            splats[g, HEADROOM] = headroom


# What blending's backward pass sums for a Gaussian over its pixels, with v = ∂L/∂ln α and e = dx − k dy: Σ v, v e, v e², v dy,
# v e dy, v dy²; then, for each channel, Σ α T ∂L/∂C.
V, VE, VEE, VY, VEY, VYY = range(6)
MOMENTS = 6


@njit(nogil=True, error_model="numpy")
def _covariance_backward(sums, b, c, determinant):
    """Gradients of the projected centre (u, v) and of Σ' = [[a, b], [b, c]] from a Gaussian's moments.

    ln α = ln o − ½ (w e)² − ½ dy² / c with precision across w² = c / det.
    """
    along = 1.0 / c
    across, shear = c / determinant, b * along
    grad_u = across * sums[VE]
    grad_v = along * sums[VY] - across * shear * sums[VE]
    grad_across, grad_along, grad_shear = -0.5 * sums[VEE], -0.5 * sums[VYY], across * sums[VEY]
    grad_a = -across * across * grad_across
    grad_b = along * grad_shear - 2.0 * shear * grad_a
    grad_c = -along * along * grad_along - shear * along * grad_shear + shear * shear * grad_a
    return grad_u, grad_v, grad_a, grad_b, grad_c


@njit(nogil=True, error_model="numpy")
def _rotation_backward(view, jacobian, grad_b0, grad_b1, quaternion):
    """Gradient of a quaternion through its unit length and Q = W R(q), from those of the rows of B = J Q."""
    i0, j0, i1, j1 = jacobian
    qw, qx, qy, qz, inverse_length = quaternion
    grad_q2 = _mix(j0, grad_b0, j1, grad_b1)
    r0 = _mix3(view[0, 0] * i0, grad_b0, view[1, 0] * i1, grad_b1, view[2, 0], grad_q2)
    r1 = _mix3(view[0, 1] * i0, grad_b0, view[1, 1] * i1, grad_b1, view[2, 1], grad_q2)
    r2 = _mix3(view[0, 2] * i0, grad_b0, view[1, 2] * i1, grad_b1, view[2, 2], grad_q2)
    dw = 2.0 * (qx * (r2[1] - r1[2]) + qy * (r0[2] - r2[0]) + qz * (r1[0] - r0[1]))
    dx = 2.0 * (-2.0 * qx * (r1[1] + r2[2]) + qy * (r1[0] + r0[1]) + qz * (r2[0] + r0[2]) + qw * (r2[1] - r1[2]))
    dy = 2.0 * (qx * (r1[0] + r0[1]) - 2.0 * qy * (r0[0] + r2[2]) + qz * (r2[1] + r1[2]) + qw * (r0[2] - r2[0]))
    dz = 2.0 * (qx * (r2[0] + r0[2]) + qy * (r2[1] + r1[2]) - 2.0 * qz * (r0[0] + r1[1]) + qw * (r1[0] - r0[1]))
    radial = dw * qw + dx * qx + dy * qy + dz * qz
    return (
        (dw - radial * qw) * inverse_length,
        (dx - radial * qx) * inverse_length,
        (dy - radial * qy) * inverse_length,
        (dz - radial * qz) * inverse_length,
    )


@njit(nogil=True, cache=True, error_model="numpy")
def project_backward(
    means, quats, scales, opacities, view, lens, radii, sums, grad_means, grad_quats, grad_scales, grad_opacities, grad_offsets, counter
):
    """Gradients of all geometry from the sums [N, MOMENTS + C] that blending left. Every row of the outputs is written."""
    fx, fy, cx, cy, width, height = lens
    while True:
        begin = take_ticket(counter) * CHUNK
        if begin >= means.shape[0]:
            break
        for g in range(begin, min(begin + CHUNK, means.shape[0])):
            grad_means[g, :], grad_quats[g, :], grad_scales[g, :], grad_offsets[g, :], grad_opacities[g] = 0.0, 0.0, 0.0, 0.0, 0.0
            if radii[g] == 0:
                continue
            x, y, z = _local(g, means, view)
            quaternion = _unit_quaternion(g, quats)
            q0, q1, q2 = _rotate(view, quaternion[0], quaternion[1], quaternion[2], quaternion[3])
            sx, sy, sz = _scale(g, scales, 0), _scale(g, scales, 1), _scale(g, scales, 2)
            inverse_z = 1.0 / z
            x, y, i0, i1 = x * inverse_z, y * inverse_z, fx * inverse_z, fy * inverse_z
            slope_x, slope_y = _slope(x, fx, cx, width), _slope(y, fy, cy, height)
            j0, j1 = -i0 * slope_x, -i1 * slope_y
            b0 = _mix(i0, q0, j0, q2)
            b1 = _mix(i1, q1, j1, q2)
            p0 = (b0[0] * sx, b0[1] * sy, b0[2] * sz)
            p1 = (b1[0] * sx, b1[1] * sy, b1[2] * sz)
            _, b, c, determinant = _covariance(p0, p1)

            grad_u, grad_v, grad_a, grad_b, grad_c = _covariance_backward(sums[g], b, c, determinant)
            grad_offsets[g, 0], grad_offsets[g, 1] = grad_u, grad_v
            if opacities[g] <= 1.0:
                grad_opacities[g] = sums[g, V] / opacities[g]

            # Σ' = P Pᵀ, P = B S, B = J Q
            grad_p0 = _mix(2.0 * grad_a, p0, grad_b, p1)
            grad_p1 = _mix(grad_b, p0, 2.0 * grad_c, p1)
            for axis in range(3):
                if abs(scales[g, axis]) <= MAX_SCALE:
                    grad_scales[g, axis] = grad_p0[axis] * b0[axis] + grad_p1[axis] * b1[axis]
            grad_b0 = (grad_p0[0] * sx, grad_p0[1] * sy, grad_p0[2] * sz)
            grad_b1 = (grad_p1[0] * sx, grad_p1[1] * sy, grad_p1[2] * sz)
            grad_i0, grad_j0 = _dot(grad_b0, q0), _dot(grad_b0, q2)
            grad_i1, grad_j1 = _dot(grad_b1, q1), _dot(grad_b1, q2)

            # the centre moves the projected centre and the Jacobian
            grad_x, grad_y = grad_u * i0, grad_v * i1
            grad_z = -(grad_x * x + grad_y * y) - (grad_i0 * i0 + grad_i1 * i1 + grad_j0 * j0 + grad_j1 * j1) * inverse_z
            if slope_x == x:
                grad_x -= grad_j0 * i0 * inverse_z
                grad_z += grad_j0 * i0 * slope_x * inverse_z
            if slope_y == y:
                grad_y -= grad_j1 * i1 * inverse_z
                grad_z += grad_j1 * i1 * slope_y * inverse_z
            for axis in range(3):
                grad_means[g, axis] = view[0, axis] * grad_x + view[1, axis] * grad_y + view[2, axis] * grad_z

            if quaternion[4] > 0.0:
                grads = _rotation_backward(view, (i0, j0, i1, j1), grad_b0, grad_b1, quaternion)
                grad_quats[g, 0], grad_quats[g, 1], grad_quats[g, 2], grad_quats[g, 3] = grads
