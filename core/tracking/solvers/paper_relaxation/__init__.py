"""The solver of the papers: relaxation, started by following the gradients."""
