"""The L-frame: found in the videos, its balls identified, and the world that it defines."""
