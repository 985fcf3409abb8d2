"""Services of every job: threads, timing, progress, files that appear whole."""
