"""Kernels as the Python functions that they are written as, for tests that need no machine code."""


def plain(kernel):
    """The function of a kernel; where kernels are not compiled it is that already."""
    return getattr(kernel, "py_func", kernel)
