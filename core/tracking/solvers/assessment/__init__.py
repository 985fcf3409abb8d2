"""Deciding between solutions: whether the images contradict one, and which of several makes them likeliest."""
