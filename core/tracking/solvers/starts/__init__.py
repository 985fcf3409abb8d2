"""Starts other than the curve through the key poses."""
