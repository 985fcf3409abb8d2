"""The tools, one a file.

What they share: `mixin` and `conditions` (when a tool can be used), `reporting` (errors and progress as Blender's
reports), `job_operator` (work in another process) and `posing_operator` (key poses made of other poses).
"""
