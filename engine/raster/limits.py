"""Constants that every back end shares; they are gsplat 1.5.3's where gsplat has them.

Numba's cache looks at the file of a kernel only: whoever changes a number here (or an operation in simd.py) deletes
engine/raster/__pycache__.
"""

NEAR, FAR = 0.01, 1e10
"""Gaussians whose centre has a camera z outside are not drawn; units of the means (scenes are normalised to about unit depth)."""

EPS2D = 0.3
"""Added to the projected variances, pixels²: no Gaussian is thinner than about half a pixel."""

MIN_ALPHA, MAX_ALPHA = 1.0 / 255.0, 0.999
"""A Gaussian weaker than MIN_ALPHA at a pixel is skipped there; none covers a pixel more than MAX_ALPHA."""

MIN_TRANSMITTANCE = 1e-4
"""A pixel is finished when the next Gaussian would leave it this little light; that Gaussian is not drawn either."""

FOV_MARGIN = 0.3
"""The projection's Jacobian is taken no further outside the image than this share of its half width and half height."""

MAX_EXTENT = 3.33
"""Half width of a Gaussian's box in standard deviations at most (an opaque Gaussian falls under MIN_ALPHA there)."""

MAX_SCALE = 1e4
"""Larger scales count as this, of either sign, since only squares matter: all are flat across the image, and float32 stays finite."""

MIN_QUAT = 1e-12
"""Shorter quaternions count as the identity."""

MAX_SQUARE = 3.4e38
"""A mean, quaternion, scale or feature vector whose squared length exceeds this (float32's largest) counts as not finite."""
