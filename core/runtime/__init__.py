"""Services for every job: threads, processes, timing, progress, atomic writing of files."""
