"""Tools that track, and that review and change what was tracked."""
