"""Writing files so that results are all old or all new, whatever happens."""
