"""Compiles kernels with the public interfaces of numba and llvmlite. Imported only if one is not cached.

    python -P -m supersampler.backends.cpu.kernel_compiler FOLDER NAME...    compiles what is not in FOLDER

numba translates a kernel to LLVM's intermediate code, which llvmlite compiles to an object file. The file has
no addresses of this process, and refers to few symbols, which `kernel_loader` defines.
"""

import gc
import importlib
import inspect
import itertools
import os
import platform
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir
from numba import cfunc, config, types

from supersampler.backends.cpu.kernel_cache import SYMBOLS, Kernel, read_kernel, write_kernel
from supersampler.backends.cpu.structs import SLOT, Bytes, Floats, Halves, Words

_POINTER = ir.PointerType()
_FIELDS: dict[Any, tuple[types.Type, ir.Type]] = {
    Floats: (types.CPointer(types.float32), _POINTER),
    Bytes: (types.CPointer(types.uint8), _POINTER),
    Halves: (types.CPointer(types.uint16), _POINTER),
    Words: (types.CPointer(types.int32), _POINTER),
    int: (types.int64, ir.IntType(64)),
    float: (types.float32, ir.FloatType()),
}
_ENTRY = "call_kernel"
_OPTIMIZATION = 1  # of LLVM's code generator; higher levels compile longer and make no kernel faster


def compile_kernel(name: str) -> Kernel:
    """Compile a kernel; see `load_kernels` for its name.

    Raises:
        NotImplementedError: the kernel refers to a symbol that `kernel_loader` does not define.
    """
    path, *parts = name.split("+")
    module_name, _, function_name = path.rpartition(".")
    function = getattr(importlib.import_module(f"supersampler.{module_name}"), function_name)
    if parts:
        function = function(*parts)
    parameters = [_type_of(p.annotation) for p in inspect.signature(function).parameters.values()]
    compiled = cfunc(types.void(*parameters), error_model="numpy")(function)
    module = llvm.parse_assembly(compiled.inspect_llvm())
    declared = {v.name for v in (*module.functions, *module.global_variables) if v.is_declaration}
    unknown = {symbol for symbol in declared if not symbol.startswith("llvm.")} - {*SYMBOLS}
    if unknown:
        raise NotImplementedError(f"kernel {name} calls {', '.join(sorted(unknown))}")
    module.link_in(llvm.parse_assembly(str(_entry(compiled.native_name, parameters))))
    slots = sum(_slots(kind) for kind in parameters)
    return Kernel(name, _ENTRY, slots, _target_machine().emit_object(module))


def _type_of(annotation: Any) -> types.Type:
    """Return numba's type for the annotation of a parameter or a field."""
    if annotation in _FIELDS:
        return _FIELDS[annotation][0]
    return types.NamedTuple([_type_of(field) for field in annotation.__annotations__.values()], annotation)


def _slots(kind: types.Type) -> int:
    return sum(map(_slots, kind)) if isinstance(kind, types.NamedTuple) else 1


def _llvm_type(kind: types.Type) -> ir.Type:
    if isinstance(kind, types.NamedTuple):
        return ir.LiteralStructType([_llvm_type(field) for field in kind])
    return dict(_FIELDS.values())[kind]


def _entry(symbol: str, parameters: Sequence[types.Type]) -> ir.Module:
    """Return a module with a function that loads the kernel's arguments from a record of slots and calls it.

    It is written in LLVM's code, so that numba compiles each kernel once. Structs are passed as values.
    """
    kinds = [_llvm_type(kind) for kind in parameters]
    module = ir.Module()
    kernel = ir.Function(module, ir.FunctionType(ir.VoidType(), kinds), symbol)
    entry = ir.Function(module, ir.FunctionType(ir.VoidType(), [_POINTER]), _ENTRY)
    builder = ir.IRBuilder(entry.append_basic_block())
    offsets = itertools.count(0, SLOT)

    def load(kind: ir.Type) -> ir.Value:
        if not isinstance(kind, ir.LiteralStructType):
            offset = ir.Constant(ir.IntType(64), next(offsets))
            slot = builder.gep(entry.args[0], [offset], source_etype=ir.IntType(8))
            return builder.load(slot, typ=kind)
        value = ir.Constant(kind, ir.Undefined)
        for index, field in enumerate(kind.elements):
            value = builder.insert_value(value, load(field), index)
        return value

    builder.call(kernel, [load(kind) for kind in kinds])
    builder.ret_void()
    return module


def _target_machine() -> llvm.TargetMachine:
    """Return the target that numba assumes, so that both generate the same instructions."""
    target = llvm.Target.from_default_triple()
    features = config.CPU_FEATURES
    return target.create_target_machine(
        cpu=config.CPU_NAME or llvm.get_host_cpu_name(),
        features=llvm.get_host_cpu_features().flatten() if features is None else features,
        opt=_OPTIMIZATION,
        reloc="static" if platform.machine().lower() in ("x86_64", "amd64") else "default",
        codemodel="jitdefault",
        jit=True,
    )


if __name__ == "__main__":
    gc.disable()  # the process is short
    sys.modules["scipy"] = None  # type: ignore[assignment]  # no kernel needs it; importing it takes long
    _folder = Path(sys.argv[1])
    for _name in sys.argv[2:]:
        if read_kernel(_folder, _name) is None:
            write_kernel(_folder, compile_kernel(_name))
    os._exit(0)  # skips the clean-up of the interpreter: another process waits for this one
