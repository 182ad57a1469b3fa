"""Arrays without a count of their references. The compiler's half is in `numba_lending`."""


def lent(value):
    """For kernels: the same array, or tuple of whatever with arrays in it, without a count of its references.

    A kernel counts the references to its arrays whenever one gets a name or goes into a function, all those
    of a tuple at once, in a way that is safe between threads: 10 ns and more each. Who is given arrays may
    lend them on, as its caller keeps them until it returns: at the beginning of a function, only of its own
    arguments, and never what it returns.
    """
    return value
