"""Backends, independent of the methods: ONNX Runtime (`onnx`), the CPU library (`cpu`), shaders (`gpu`)."""
