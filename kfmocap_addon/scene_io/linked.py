"""Which data blocks are linked from another file, in which alone some of what they hold can be changed."""

import bpy


def linked_file(block: bpy.types.ID) -> str:
    """Return the name of the file that a data block, or what it overrides, is linked from; empty for one of this file's
    own.
    """
    original = block.override_library.reference if block.override_library is not None else block
    library = original.library if original is not None else None
    return bpy.path.basename(library.filepath) if library is not None else ""
