"""ONNX Runtime without telemetry; the whole package imports it from here.

Since 1.29, official builds for Linux and macOS write a device id and a database to the user's cache during
the import, and later send names and hashes of models to Microsoft. The variable `ORT_DISABLE_TELEMETRY`
prevents all of that. It is read during the import only, so it is set for the import and then removed.
`disable_telemetry_events` is for Windows, and for programs that have already imported onnxruntime.

If the user has set the variable, to any value, nothing is changed.
"""

import os

_VARIABLE = "ORT_DISABLE_TELEMETRY"

if _VARIABLE in os.environ:
    import onnxruntime as ort
else:
    os.environ[_VARIABLE] = "1"
    try:
        import onnxruntime as ort
    finally:
        os.environ.pop(_VARIABLE, None)
    ort.disable_telemetry_events()

__all__ = ["ort"]
