"""Step time, first-frame time and counted work of methods, and time against quality."""
