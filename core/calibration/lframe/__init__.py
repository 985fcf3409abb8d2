"""The L-frame: found in the videos, its balls told apart, and the world that it defines."""
