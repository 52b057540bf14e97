"""The DeGense engine: the whole 4D Gaussian stack, without Qt and without VTK."""
