"""ONNX Runtime with its telemetry off; the whole package imports it from here.

Official builds for Linux and macOS since 1.29 write a device id and a database into the user's cache while
they are imported, and later tell Microsoft what sessions are made of: a model's name, hashes of its graph.
One variable stops all of that, `ORT_DISABLE_TELEMETRY`. It is read once, during the import, so it is set for
the import alone, and the environment is then as it was. `disable_telemetry_events` comes too late for the
device id; it is what builds for Windows listen to, and all that is left where the program has imported
onnxruntime before this package.

Whoever has set the variable, to any value, has decided himself: nothing is changed then.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager

_VARIABLE = "ORT_DISABLE_TELEMETRY"


@contextmanager
def _telemetry_off() -> Iterator[None]:
    os.environ[_VARIABLE] = "1"
    try:
        yield
    finally:
        os.environ.pop(_VARIABLE, None)


if _VARIABLE in os.environ:
    import onnxruntime as ort
else:
    with _telemetry_off():
        import onnxruntime as ort
    ort.disable_telemetry_events()

__all__ = ["ort"]
