"""What every job needs beside its task: threads, timing, progress, files that appear whole."""
