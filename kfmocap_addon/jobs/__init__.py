"""Work in a process of its own beside Blender."""
