"""Making poses and keys, for the tools that do so."""
