"""Studies of single parts: each a command of its own, `python -m kfmocap.benchmarks.studies.NAME --help`."""
