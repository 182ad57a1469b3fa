"""A compiled kernel as bytes, and back: what is kept in a file and loaded by other processes."""

import pickle
import re
from collections import Counter

from llvmlite.binding import address_of_symbol
from numba.core.compiler import CompileResult
from numba.core.runtime import rtsys
from numba.core.serialize import dumps


def reduced(cres):
    """Content of the file of a compiled kernel: bytes. The bitcode, which numba keeps, nobody needs."""
    library, fndesc = cres.library, cres.fndesc
    fndesc.typemap = fndesc.calltypes = None
    module = library._final_module
    names = {False: [], True: []}  # whether they are from elsewhere
    for of in (module.functions, module.global_variables):
        for one in of:
            names[one.is_declaration].append(one.name)
    wanted = [name for name in names[True] if not name.startswith("llvm.")]
    parts = library.name, library._get_compiled_object(), names[False], wanted, fndesc, cres.environment
    return dumps((*parts, cres.signature, cres.reload_init, environments(cres, str(module))))


def environments(cres, text):
    """Environments that the code of a module, whose text this is, asks for: list.

    numba lists those of all functions that were put into it. Each would be made when the code is loaded, with
    all that its module imports.
    """
    named = Counter(re.findall(r'@"?(_ZN08NumbaEnv[^\s",)]*)', text))  # once where it is declared
    return [one for one in cres._find_referenced_environments() if named[one.env_name] > 1 or one.consts]


def provide(target_context, names):
    """Let code be linked that uses these names: without the address of one, LLVM would end the process.

    Numba is set up for that only as far as it has to be: all of it would take a third of a second.
    """
    for set_up in (rtsys.initialize, type(target_context).refresh):
        if all(map(address_of_symbol, names)):
            return
        set_up(target_context)


def rebuilt(target_context, content):
    """CompileResult of such a content."""
    name, code, names, wanted, fndesc, environment, *others = pickle.loads(content)
    its_signature, reload_init, kept = others
    for function in reload_init:
        function()
    provide(target_context, wanted)
    codegen = target_context.codegen()
    library = codegen.create_library(name)
    library.enable_object_caching()
    library._set_compiled_object(code)
    library._finalize_final_module()
    codegen._engine._defined_symbols.update(names)
    entry_point = target_context.get_executable(library, fndesc, environment)
    for one in kept:
        codegen.set_env(one.env_name, one)
    return CompileResult(
        target_context=target_context,
        typing_context=target_context.typing_context,
        library=library,
        environment=environment,
        entry_point=entry_point,
        fndesc=fndesc,
        signature=its_signature,
        objectmode=False,
        lifted=(),
        typing_error=None,
        type_annotation="",
        call_helper=None,
        metadata=None,
        reload_init=reload_init,
        referenced_envs=kept,
    )
