"""Files and what people see: images, shots, importers, the display transform, the comparison page.

Everything that a stranger's file may claim is checked here; nothing here steps a frame.
"""
