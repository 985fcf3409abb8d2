"""Rigs of other people: how their controls move them, read by trying, and keys for these controls."""
