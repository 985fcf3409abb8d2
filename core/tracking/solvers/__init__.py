"""Solvers: from the evidence of a segment to its poses."""
