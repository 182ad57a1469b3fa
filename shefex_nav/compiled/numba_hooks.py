"""All that this project uses of numba's inside, with `machine_code` and `numba_lending`.

numba compiles, optimises and emits every function on its own, and again inside each function that calls it:
a kernel at the end of five calls goes through the optimiser five times. Here a function that another kernel
calls is translated to LLVM's language only; what Python calls is linked with everything it needs, optimised
and emitted once. The result is kept in a file named by the digest of the whole, see `store`.

Private interfaces of numba are used in these three files and in no other; pyproject.toml pins numba for their
sake.
"""

import gc
import hashlib
import json
import os
import platform
import re
import sys
from contextlib import contextmanager, nullcontext
from functools import cached_property

import llvmlite
import numba
import numpy as np
from numba.core import config, types
from numba.core.caching import NullCache, _cache_log
from numba.core.codegen import JITCodeLibrary, RuntimeLinker
from numba.core.compiler_lock import global_compiler_lock, require_global_compiler_lock
from numba.core.cpu_options import FastMathOptions
from numba.core.dispatcher import Dispatcher, _FunctionCompiler
from numba.core.registry import CPUDispatcher, cpu_target
from numba.extending import overload

from shefex_nav.compiled import digest, machine_code, numba_lending, signature
from shefex_nav.compiled.store import Store

USES = "SHEFEX_NAV_KERNELS_USED"  # environment variable: a file to which used kernels are appended
SETTINGS = (  # of numba, that change what it compiles
    *("OPT", "BOUNDSCHECK", "LOOP_VECTORIZE", "SLP_VECTORIZE", "USING_SVML", "LLVM_REFPRUNE_PASS"),
    *("LLVM_REFPRUNE_FLAGS", "DEBUGINFO_DEFAULT", "EXTEND_VARIABLE_LIFETIMES", "ENABLE_PROFILING"),
    *("FULL_TRACEBACKS", "DEBUG_NRT", "DEBUG_NRT_STACK_LIMIT", "USE_LLVMLITE_MEMORY_MANAGER"),
)

begins_to_compile = []  # functions of a kernel and of whether it is kept, called before it is compiled


class _LateLibrary(JITCodeLibrary):
    """Code that is linked, optimised and emitted when its address is asked for: of most functions never."""

    _alone = None  # its LLVM module without what it calls, for linking

    def add_linking_library(self, library):
        self._linking_libraries.append(library)

    def finalize(self):
        require_global_compiler_lock()
        self._codegen._check_llvm_bugs()
        self._raise_if_finalized()
        for library in _needed(self):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(_linkable(library), preserve=True)
        _keep_inside(self._final_module)
        self._optimize_final_module()
        self._final_module.verify()
        self._finalize_final_module()


def _needed(library):
    """The libraries that one calls, directly or not, each once, every caller before what it calls.

    LLVM's linker takes from a module what is called so far. A finalised library contains what it calls.
    """
    done, seen = [], set()

    def visit(one):
        seen.add(one)
        if not one._finalized:
            for called in one._linking_libraries:
                if called not in seen:
                    visit(called)
        done.append(one)

    visit(library)
    return done[-2::-1]


def _linkable(library):
    """LLVM module of a library, to be linked into another; its functions may be defined more than once."""
    if library._finalized or not isinstance(library, _LateLibrary):
        return library._get_module_for_linking()
    if library._alone is None:
        library._alone = library._final_module.clone()
        for function in library._alone.functions:
            if not function.is_declaration and function.linkage.name == "external":
                function.linkage = "linkonce_odr"
    return library._alone


class _Address:
    """Stands for a callee where numba keeps the address of a compiled function."""


def _without_entry(flags):
    """Flags of a function that kernels call: without a way in from Python, without machine code."""
    flags.no_compile = True
    flags.no_cpython_wrapper = True
    flags.no_cfunc_wrapper = True
    return flags


def _of_numba(self, flags):
    """Flags of numba's own functions; they would be those of the first kernel that calls them."""
    flags.error_model, flags.fastmath = "python", FastMathOptions(False)
    return _without_entry(flags)


class _CalleeCompiler(_FunctionCompiler):
    """Compiles a kernel for other kernels."""

    def _customize_flags(self, flags):
        return _without_entry(flags)


def _add_callee(self, cres):
    """Dispatcher.add_overload of such a function."""
    address = _Address()
    self.targetctx.insert_user_function(address, cres.fndesc, [cres.library])
    self.overloads[tuple(cres.signature.args)] = cres._replace(entry_point=address)


def _keep_inside(module):
    """Nobody else calls the copies of functions in a module: the optimiser may do with them as it likes."""
    prefix = RuntimeLinker.PREFIX  # of recursive functions, whose address is asked for
    asked_for = {
        one.name.removeprefix(prefix) for one in module.global_variables if one.name.startswith(prefix)
    }
    for function in module.functions:
        if function.linkage.name == "linkonce_odr" and function.name not in asked_for:
            function.linkage = "internal"


def _another_shape(shape, into):
    """Raise the error of an array that does not fit into a slice.

    numba's own tells both shapes; to put that text together takes a tenth of the time of all compiling.
    """


@overload(_another_shape)
def _raise_another_shape(shape, into):
    def implementation(shape, into):
        raise ValueError("cannot put an array into a slice of another shape")

    return implementation


@contextmanager
def _within_a_kernel():
    """What numba compiles of itself meanwhile, such as np.zeros, becomes part of the kernel that needs it."""
    from numba.np import arrayobj

    codegen = cpu_target.target_context.codegen()
    before = codegen._library_class, _FunctionCompiler._customize_flags
    codegen._library_class, _FunctionCompiler._customize_flags = _LateLibrary, _of_numba
    CPUDispatcher.add_overload = _add_callee
    long_error, arrayobj.raise_with_shape_context = arrayobj.raise_with_shape_context, _another_shape
    try:
        yield
    finally:
        arrayobj.raise_with_shape_context = long_error
        codegen._library_class, _FunctionCompiler._customize_flags = before
        del CPUDispatcher.add_overload


class _EntryCompiler(_FunctionCompiler):
    """Compiles what Python calls; nobody takes its address as C's."""

    def compile(self, args, return_type):
        with _within_a_kernel(), _uninterrupted_memory():
            return super().compile(args, return_type)

    def _customize_flags(self, flags):
        flags.no_cfunc_wrapper = True
        return flags


def _use(dispatcher, compiler):
    """Let a dispatcher compile with another class of compiler."""
    old = dispatcher._compiler
    dispatcher._compiler = compiler(
        old.py_func, old.targetdescr, old.targetoptions, old.locals, old.pipeline_class
    )


_compiled_from = {}  # what a callee was when it was compiled: function -> digest.own


class _Callee(CPUDispatcher):
    """A kernel as other kernels, and functions that others compile, see it."""

    def add_overload(self, cres):
        _compiled_from.setdefault(self.py_func, digest.own(self.py_func))
        _add_callee(self, cres)

    def __init__(self, py_func, targetoptions):
        super().__init__(py_func, targetoptions=targetoptions)
        _use(self, _CalleeCompiler)

    def get_call_template(self, args, kws):
        """As numba's; a 3 is any integer, for a copy of the function for each number only costs time."""
        widened = tuple(types.unliteral(one) for one in args)
        return super().get_call_template(widened, {k: types.unliteral(v) for k, v in kws.items()})


class Kernel(CPUDispatcher):
    """A kernel as Python sees it; kernels that call it are shown its `callee`."""

    def __init__(self, py_func, targetoptions):
        super().__init__(py_func, targetoptions=targetoptions)
        _use(self, _EntryCompiler)
        self.typingctx._remove_global(self)
        self._cache = _Files(self)

    @cached_property
    def callee(self):
        """Made when the first kernel that calls this one is compiled, which is often never."""
        return _Callee(self.py_func, self.targetoptions)

    @cached_property
    def _numba_type_(self):
        return types.Dispatcher(self.callee)

    def __reduce__(self):
        return signature.find, (signature.name(self),)

    def compile(self, sig):
        """Load or compile for these types of arguments, a tuple. -> what Python calls"""
        with global_compiler_lock, self._cache.alone(sig):
            return super().compile(sig)

    def add_overload(self, cres):
        Dispatcher.add_overload(self, cres)
        for env in cres.referenced_envs or cres._find_referenced_environments():
            cres.codegen.set_env(env.env_name, env)

    def entry(self, *args):
        """As `compiled.entry`."""
        given, defaults = len(args), self.py_func.__defaults__ or ()
        left = self.py_func.__code__.co_argcount - given
        omitted = map(types.Omitted, defaults[len(defaults) - left :])
        return self.compile((*map(self.typeof_pyval, args), *omitted))

    def file_of(self, args, known=None):
        """Path of the file of compiled code for types of arguments; None: it has to be compiled.

        known : as for `digest.closure`
        """
        name = self._cache.name(args, known)
        return None if name is None else store().path(name)


@contextmanager
def _uninterrupted_memory():
    """Python's search for cycles takes a sixth of the time of compiling, and finds nothing worth it."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


class _Files(NullCache):
    """The cache of a kernel, as numba's Dispatcher uses it."""

    def __init__(self, kernel):
        self._kernel = kernel
        self._wanted = None  # name of the file that is loaded or made now

    def name(self, args, known=None):
        """Name of the file for types of arguments, as all is now; None if these have no name."""
        try:
            text = json.dumps([signature.encode(one) for one in args])
        except signature.UnknownType:
            return None
        whole = f"{digest.of_kernel(self._kernel, known)} {text} {_settings()}"
        short = hashlib.sha256(text.encode()).hexdigest()[:6]
        stem = re.sub(r"[^\w.]", "_", signature.name(self._kernel).replace(":", "."))  # <lambda> is no file
        return f"{stem}-{short}-{hashlib.sha256(whole.encode()).hexdigest()[:20]}"

    def alone(self, args):
        """Context in which no other process compiles the same, if it has to be compiled at all."""
        name = self._wanted = self.name(args)
        return nullcontext() if name is None or store().path(name) else store().alone(name)

    def load_overload(self, sig, target_context):
        _note_use(self._kernel, sig)
        content = None if self._wanted is None else store().load(self._wanted)
        if content is None:
            for listen in begins_to_compile:
                listen(self._kernel, self._wanted is not None)
            return None
        _cache_log("[cache] data loaded from %r", self._wanted)
        return machine_code.rebuilt(target_context, content)

    def save_overload(self, sig, cres):
        if self._wanted is None or cres.library.has_dynamic_globals or not self._is_as_named(sig):
            return
        if path := store().save(self._wanted, machine_code.reduced(cres)):
            _cache_log("[cache] data saved to %r", path)

    def _is_as_named(self, args):
        """Whether what was compiled is what the name says: a global may have become another meanwhile, or
        since a callee was compiled, which is used again.
        """
        parts = digest.closure(self._kernel)
        unchanged = all(_compiled_from.get(function, one) == one for function, one in parts.items())
        return unchanged and self.name(args) == self._wanted


def _note_use(kernel, args):
    """Append a kernel to the file in which a list of those that are used is wanted.

    UnknownType for arguments of a type that has no name: such a kernel is compiled in every process.
    """
    if path := os.environ.get(USES):
        line = json.dumps([signature.name(kernel), [signature.encode(one) for one in args]])
        with open(path, "a", encoding="utf-8") as file:
            file.write(line + "\n")


_STORE = None


def store():
    """The Store of this process's kernels."""
    global _STORE
    if _STORE is None:
        _STORE = Store(_kind())
    return _STORE


def _settings():
    """SETTINGS as they are now: numba reads the environment again whenever it compiles."""
    config.reload_config()
    return [getattr(config, name) for name in SETTINGS]


_AT_FIRST = _settings()  # some are used when the compiler is set up, too


def _kind():
    """Name of all that code depends on besides the kernels: versions, processor, settings of the compiler."""
    triple, processor, features = cpu_target.target_context.codegen().magic_tuple()
    makers = sys.modules[__name__], numba_lending, machine_code, digest, signature
    made_by = [_text(one) for one in makers]
    rest = f"{triple} {features} {_AT_FIRST} {made_by}"
    numpy = ".".join(np.__version__.split(".")[:2])
    python = f"{sys.implementation.cache_tag}-{platform.machine()}-{sys.platform}"
    versions = f"numba{numba.__version__}-llvmlite{llvmlite.__version__}-numpy{numpy}"
    return f"{python}-{processor}-{versions}-{hashlib.sha256(rest.encode()).hexdigest()[:8]}"


def _text(module):
    """A module's source; its instructions where only these are installed."""
    loader = module.__spec__.loader
    return loader.get_source(module.__name__) or digest.of_code(loader.get_code(module.__name__))
