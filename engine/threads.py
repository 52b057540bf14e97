"""One lock around every parallel numba kernel.

Numba's portable threading layer must not be entered by two Python threads at once, and the window draws from one thread while another answers a prompt.
The kernels use all cores anyway, so taking turns costs nothing.
"""

import threading

KERNEL_LOCK = threading.RLock()
