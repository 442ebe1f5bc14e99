"""C types of wgpu, parsed in one go.

wgpu names its C types by strings. For each new string, cffi parses the declarations of all types again, in
Python, which is slow. It keeps the types that it has parsed.
"""

from functools import cache


@cache
def parse_all_types() -> None:
    """Let cffi parse pointers to all types of wgpu at once.

    It reads and fills private attributes of cffi: where they are others, nothing is done, and each type is
    parsed when it is asked for.
    """
    try:
        from wgpu.backends.wgpu_native._ffi import ffi

        declared, parsed = ffi._parser._declarations, ffi._parsed_types
    except (ImportError, AttributeError):
        return
    names = [name.removeprefix("typedef ") for name in declared if name.startswith("typedef WGPU")]
    members = "".join(f"{name} *{name}_;" for name in names)
    ffi.cdef(f"struct supersampler_types {{ {members} }};")
    for member, field in ffi.typeof("struct supersampler_types").fields:
        parsed.setdefault(f"{member.removesuffix('_')} *", (field.type, False))
