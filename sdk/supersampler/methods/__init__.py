"""Methods: the registry, model folders, and a subpackage for each method with its `spec` and shaders."""
