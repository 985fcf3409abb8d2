"""The least-squares problem of a segment: its unknowns and data, the factors, and the normal equations of their sum."""
