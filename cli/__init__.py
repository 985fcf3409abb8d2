"""The command line: `kfmocap ...`, and `blender ... --command kfmocap ...` inside Blender.

`command_line.main` runs it. What needs Blender or the benchmark is handed in as `services.Services`.
"""
