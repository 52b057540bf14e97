"""The DeGense engine: the whole 4D Gaussian stack, without Qt and without VTK."""

import os

# Two thread pools (torch's and numba's) share the cores with a window. Threads that spin while they wait make all of them slow on a busy
# machine: measured on two cores, a training step beside three other processes took 4 s with spinning threads and 0.9 s with sleeping ones.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
