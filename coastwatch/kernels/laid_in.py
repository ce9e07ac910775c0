"""How code that other compiled code calls, and Python never does, is compiled: as far as its callers need it, and no further.

numba optimises every function by itself, makes machine code of it and two ways to call it, and then lays it into its callers, where it
is optimised again. Here only the last is left, where loops and shapes are known (`python -m
scaling.load.first_cycle` times what a run compiles).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import llvmlite.binding as llvm
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, compile_result
from numba.core.registry import CPUDispatcher

UNCALLED = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


class _Nowhere:
    """Stands for the code generator of a function without machine code: it has no place in memory for the names it knows."""

    def set_env(self, name: str, environment: Any) -> None:
        """Nothing to set: the caller that it is laid into has its own."""


class _Library(JITCodeLibrary):
    """Instructions of LLVM, never machine code."""

    @property
    def codegen(self) -> Any:
        return _Nowhere()

    def _optimize_final_module(self) -> None:
        """Left to the caller."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """There is none."""
        return 0

    def serialize_using_object_code(self) -> bytes:
        """What is kept on disk."""
        bitcode: bytes = self._get_module_for_linking().as_bitcode()
        return bitcode


class _Compiler(Compiler):
    def compile_extra(self, func: Callable[..., Any]) -> Any:
        self.state.library = _Library(self.state.targetctx.codegen(), func.__qualname__)
        return super().compile_extra(func)


class _Kept(CompileResultCacheImpl):
    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        """Under another name than numba's own: what an earlier version left of the same function is another thing."""
        return f"laid-in-{super().get_filename_base(fullname, abiflags)}"

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        bitcode, described, environment, signature, object_mode, lifted, annotation, reload_init, referenced = payload
        library = _Library(target_context.codegen(), described.qualname)
        library._final_module = llvm.parse_bitcode(bitcode)
        library._finalize_final_module()
        return compile_result(
            target_context=target_context,
            typing_context=target_context.typing_context,
            library=library,
            environment=environment,
            entry_point=target_context.get_executable(library, described, environment),
            fndesc=described,
            type_annotation=annotation,
            signature=signature,
            objectmode=object_mode,
            lifted=lifted,
            reload_init=reload_init,
            referenced_envs=referenced,
        )


class _Cache(FunctionCache):
    _impl_class = _Kept


class LaidIn(CPUDispatcher):
    """A function for compiled code alone."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        """Args: options: as of `numba.njit`, without `cache`: it is always kept on disk."""
        super().__init__(function, targetoptions={"nopython": True, **options, **UNCALLED}, pipeline_class=_Compiler)
        self._cache = _Cache(self.py_func)

    def __call__(self, *given: Any) -> Any:
        raise TypeError(f"{self.py_func.__qualname__} is for compiled code, which lays it into itself; Python cannot call it")
