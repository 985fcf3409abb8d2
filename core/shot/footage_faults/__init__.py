"""What may be wrong with footage: its size, times and frames, and damage that the decoder finds."""
