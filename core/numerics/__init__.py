"""Mathematics that knows nothing of cameras or bodies."""
