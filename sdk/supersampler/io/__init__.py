"""Files and display: images, shots, importers, the display transform, the comparison page.

The content of every file is checked here before it is used. No upscaling happens here.
"""
