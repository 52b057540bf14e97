"""The DeGense engine: the whole 4D Gaussian stack, without Qt and without VTK."""

import os

# Two thread pools (torch's and numba's) share the cores with a window. Threads that spin while they wait make all of them slow on a busy
# machine: measured on two cores, a training step beside three other processes took 4 s with spinning threads and 0.9 s with sleeping ones.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
# OpenBLAS's threads, numpy's and OpenCV's, wait in a loop too, for 2^26 cycles after each product unless told otherwise, here 2^4: on two
# cores a product of 1,000 × 128 descriptors took 54 ms of processors and takes 7, and `quick` trains 4 % sooner.
os.environ.setdefault("OPENBLAS_THREAD_TIMEOUT", "4")
