"""Solving the segments of a shot in several processes, in an order that does not depend on their number."""
