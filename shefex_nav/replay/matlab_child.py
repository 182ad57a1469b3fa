"""The structure of a Matlab file on standard output, as a NumPy archive: a program, run by `navego`.

A damaged file can crash scipy's reader, or have it ask for any amount of memory. Here that ends this process
alone. It imports nothing of the package, so that it starts at once.

Arguments: the file, then the fields that are wanted. Exit codes: 0 done, 3 with what is wrong in one line on
standard error.
"""

import json
import sys

MOST_MEMORY = 4 << 30  # bytes of address space
MOST_NUMBERS = 1 << 27  # in all fields: 1 GiB
KINDS = "kinds"  # entry: JSON, {field: name of its dtype} of the one structure, or the number of structures
FIELD = "field "  # before the name of a field: some names have a meaning for `numpy.savez`
REFUSED = 3  # exit code


def main(path, *wanted):
    """Write what the structure of a file holds. -> what is wrong with it, or nothing"""
    import numpy as np
    from scipy.io import loadmat

    _limited()
    try:
        content = loadmat(path, squeeze_me=True, struct_as_record=False, appendmat=False)
        found = [value for value in content.values() if hasattr(value, "_fieldnames")]
        if len(found) != 1:
            np.savez(sys.stdout.buffer, **{KINDS: json.dumps(len(found))})
            return ""
        arrays = {name: np.asarray(getattr(found[0], name)) for name in found[0]._fieldnames}
        kinds = {name: value.dtype.name for name, value in arrays.items()}
        numbers = {
            name: arrays[name] for name in wanted if name in arrays and arrays[name].dtype.kind in "fiu"
        }
        if sum(value.size for value in numbers.values()) > MOST_NUMBERS:
            return f"has more than {MOST_NUMBERS} numbers"
        columns = {FIELD + name: np.array(value, dtype=float) for name, value in numbers.items()}
        np.savez(sys.stdout.buffer, **{KINDS: json.dumps(kinds)}, **columns)
    except NotImplementedError:
        return "is a Matlab file of version 7.3; save it with -v7"
    except MemoryError:
        return f"cannot be read as a Matlab file: it takes more than {MOST_MEMORY >> 30} GiB"
    except Exception as error:  # whatever a file that is none makes the reader do
        return f"cannot be read as a Matlab file: {error}"
    return ""


def _limited():
    """Let this process have so much memory and no more, where the system can say so."""
    try:
        import resource
    except ImportError:
        return
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))


if __name__ == "__main__":
    words = main(*sys.argv[1:])
    if words:
        print(" ".join(words.split()), file=sys.stderr)
        sys.exit(REFUSED)
